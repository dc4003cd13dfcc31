"""Points from which a multi-start search begins: a Latin hypercube over the priors, or given ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from jaxmuscle.errors import InputError
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.parameter_names import resolve, spelled

INSIDE = 1e-3
"""Distance from a bound at which a start lies at least, in units of the scale."""


def spread_starts(unknowns: Unknowns, count: int, seed: int) -> Float[np.ndarray, "starts k"]:
    """The unknowns' own start, then a Latin hypercube of `count` - 1 (McKay et al. 1979, as in SciPy).

    Each coordinate is spread normally about its prior's mean with its standard deviation, or about its
    start with its scale where there is no prior; of positive parameters the logarithm. What falls beyond a
    bound is set beside it.
    """
    own = unknowns.coordinates(unknowns.start)
    if count == 1:
        return own[None]
    middles = np.array([e.prior.mean if e.prior else e.start for e in unknowns.entries])
    means = unknowns.coordinates(middles)
    # A generator, of which every version of SciPy makes the same; the argument is `rng` too from 1.15 on.
    generator = np.random.default_rng(seed)
    hypercube = qmc.LatinHypercube(len(unknowns), seed=generator)  # pyright: ignore[reportCallIssue]
    uniform = hypercube.random(count - 1)
    # Of what may be zero or negative a coordinate is one scale already.
    sizes = np.where(unknowns.logarithmic, unknowns.scale / np.where(middles == 0, 1.0, middles), 1.0)
    drawn = means + sizes * ndtri(uniform)
    return np.vstack([own, _within(unknowns, drawn)])


def given_starts(
    unknowns: Unknowns, starts: Sequence[Mapping[str, float]], where: str = "starts"
) -> Float[np.ndarray, "starts k"]:
    """Starts that the user gives: name → value (SI), the unknowns' own start for what is not named.

    A parameter that each recording has of its own is named as in the result, ``mass[lift-2]``, or without
    the recording for all of them.

    Raises:
        InputError: an unknown name, or a value beyond its bounds.
    """
    if not starts:
        raise InputError(f"{where}: expected a number of starts or at least one mapping of values; got none")
    points = []
    for number, given in enumerate(starts):
        here = f"{where}[{number}]"
        if not isinstance(given, Mapping):
            raise InputError(f"{here}: expected a mapping of names to values; got {given!r}")
        values = unknowns.start.copy()
        for name, value in given.items():
            if not isinstance(value, Real):
                raise InputError(f"{here}: expected a number (SI) for {name!r}; got {value!r}")
            values[_positions(unknowns, name, here)] = float(value)
        for entry, value in zip(unknowns.entries, values.tolist(), strict=True):
            if not entry.lower <= value <= entry.upper or (entry.place.positive and value <= 0):
                raise InputError(
                    f"{here}: {entry.name} = {value:g} is not within its bounds, "
                    f"{entry.lower:g} to {entry.upper:g} {entry.place.unit}".rstrip()
                )
        points.append(unknowns.coordinates(values))
    return np.stack(points)


def _positions(unknowns: Unknowns, name: str, where: str) -> list[int]:
    """Where a name stands in the vector: its own name, or that of a place in every recording."""
    known: dict[str, str] = {}
    for entry in unknowns.entries:
        place = {entry.place.name: entry.place.path}
        known |= spelled(place) | spelled(place, entry.name.removeprefix(entry.place.name))
    found = resolve(known, name, where, "{} is not free")
    return [i for i, entry in enumerate(unknowns.entries) if found in (entry.name, entry.place.name)]


def _within(unknowns: Unknowns, points: NDArray[np.float64]) -> NDArray[np.float64]:
    room = np.minimum(INSIDE, 0.5 * (unknowns.upper - unknowns.lower))
    return np.clip(points, unknowns.lower + room, unknowns.upper - room)
