"""Where fits begin: a Latin hypercube over what is known beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.special import ndtri

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.unknowns import Unknowns

INSIDE = 1e-3
"""Distance from a bound at which a start lies at least, in units of the scale."""


def spread_starts(unknowns: Unknowns, count: int, seed: int) -> Float[NDArray, "starts k"]:
    """The unknowns' own start, then a Latin hypercube of `count` - 1 (McKay et al. 1979).

    Each coordinate is spread normally about its prior's mean with its standard deviation, or about its
    start with its scale where there is no prior; of positive parameters the logarithm. What falls beyond a
    bound is set beside it.
    """
    own = unknowns.coordinates(unknowns.start)
    if count == 1:
        return own[None]
    middles = np.array([e.prior.mean if e.prior else e.start for e in unknowns.entries])
    means = unknowns.coordinates(middles)
    rng = np.random.default_rng(seed)
    shares = np.stack([rng.permutation(count - 1) for _ in unknowns.entries], axis=-1)
    uniform = (shares + rng.random(shares.shape)) / (count - 1)
    # Of what may be zero or negative a coordinate is one scale already.
    sizes = np.where(unknowns.logarithmic, unknowns.scale / np.where(middles == 0, 1.0, middles), 1.0)
    drawn = means + sizes * ndtri(uniform)
    return np.vstack([own, _within(unknowns, drawn)])


def given_starts(
    unknowns: Unknowns, starts: Sequence[Mapping[str, float]], where: str = "starts"
) -> Float[NDArray, "starts k"]:
    """Starts that the user gives: name → value (SI), the unknowns' own start for what is not named.

    Raises:
        InputError: an unknown name, or a value beyond its bounds.
    """
    if not starts:
        raise InputError(f"{where}: expected a number of starts or at least one mapping of values; got none")
    points = []
    for number, given in enumerate(starts):
        values = unknowns.start.copy()
        for name, value in given.items():
            if name not in unknowns.names:
                raise InputError(f"{where}[{number}]: {name!r} is not free{nearest(name, unknowns.names)}")
            values[unknowns.names.index(name)] = value
        u = unknowns.coordinates(values)
        for entry, at, low, high in zip(unknowns.entries, u, unknowns.lower, unknowns.upper, strict=True):
            if not low <= at <= high:
                raise InputError(
                    f"{where}[{number}]: {entry.name} = {given.get(entry.name)} is not within its bounds, "
                    f"{entry.lower:g} to {entry.upper:g} {entry.place.unit}"
                )
        points.append(u)
    return np.stack(points)


def _within(unknowns: Unknowns, points: NDArray[np.float64]) -> NDArray[np.float64]:
    room = np.minimum(INSIDE, 0.5 * (unknowns.upper - unknowns.lower))
    return np.clip(points, unknowns.lower + room, unknowns.upper - room)
