"""One unknown of a fit, its start, bounds and prior held against each other."""

from __future__ import annotations

import math

from jaxmuscle.errors import InputError
from jaxmuscle.estimation.asked import Bounds
from jaxmuscle.estimation.unknowns import HALF, Unknown
from jaxmuscle.fitting.prior import Prior
from jaxmuscle.parameter_names import of_machine
from jaxmuscle.parameters import Parameter


def unknown_within(
    name: str,
    place: Parameter,
    recordings: tuple[int, ...],
    start: float,
    prior: Prior | None,
    bounds: Bounds,
) -> Unknown:
    """An unknown that starts within its bounds.

    Raises:
        InputError: bounds in the wrong order, a start outside, a prior that is none or contradicts them.
    """
    floor = 0.0 if place.positive or place.nonnegative else -math.inf
    lower = floor if bounds[0] is None else max(bounds[0], floor)
    upper = math.inf if bounds[1] is None else bounds[1]
    within = f"{lower:g} to {upper:g} {place.unit}".rstrip()
    if not lower < upper:
        raise InputError(f"bounds of {name}: expected a lower one below the upper one; got {within}")
    if not lower <= start <= upper or (place.positive and start <= 0):
        raise InputError(
            f"bounds of {name}: its start, {start:g}, is not within {within}; "
            f"widen the bounds, or start elsewhere: jaxmuscle.replace(actuator, {{{place.path!r}: …}})"
        )
    if prior is not None:
        if not (math.isfinite(prior.mean) and 0 < prior.std < math.inf):
            raise InputError(f"prior of {name}: expected (mean, std) with a std above zero; got {prior}")
        if not lower <= prior.mean <= upper or (place.positive and prior.mean <= 0):
            raise InputError(
                f"prior of {name}: its mean, {prior.mean:g}, contradicts the bounds {within}; "
                f"change one of them"
            )
    # The first reading of a state may be next to zero, and says nothing of how far the state may be from it.
    natural = HALF * abs(start) if of_machine(place.path) else place.typical or HALF * abs(start)
    scale = prior.std if prior else natural or place.typical or 1.0
    return Unknown(name, place, recordings, start, lower, upper, scale, prior)
