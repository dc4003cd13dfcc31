"""Profile likelihoods: how the cost rises when one parameter is held and all others are fitted anew."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.covariance import Covariance
from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import CONVERGED, STALLED, Lane, Limits, Local
from jaxmuscle.estimation.unknowns import Unknowns

OPEN_STEP = 0.2
"""Step of a parameter without a standard deviation: a factor of 1.2, or a fifth of its scale."""
STEPS_OUT = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
"""Where a profile is computed, in standard deviations from the estimate."""
QUANTILE = 1.959964
"""Of the normal distribution, for intervals of 95 %."""
ENDED = (CONVERGED, STALLED)
"""How a point ends that tells how low the cost can be there."""


@dataclasses.dataclass(frozen=True)
class Profile:
    """Profile of one parameter.

    Attributes:
        values: of the parameter (SI), increasing, the estimate among them.
        deviance: twice the rise of the cost over the estimate's, divided by how much more its variance is
            than that of independent residuals; chi-squared with one degree of freedom.
        lower, upper: where it crosses 3.84 (95 %); a bound that comes first; infinite if it does not cross
            within three standard deviations.
        missing: points out of six that failed, or for which steps or time were too few.
    """

    name: str
    values: NDArray[np.float64]
    deviance: NDArray[np.float64]
    lower: float
    upper: float
    missing: int = 0

    @property
    def roots(self) -> NDArray[np.float64]:
        """Signed roots of the deviance, negative below the estimate: nearly a straight line."""
        below = np.arange(len(self.values)) < int(np.argmin(np.abs(self.deviance)))
        return np.where(below, -1.0, 1.0) * np.sqrt(np.maximum(self.deviance, 0.0))


def profiles(
    evaluate: Callable[[Float[np.ndarray, "lanes k"]], list[Local]],
    unknowns: Unknowns,
    best: tuple[NDArray[np.float64], float],
    sure: Covariance,
    chosen: Sequence[int],
    limits: Limits,
) -> list[Profile]:
    """Profiles of the coordinates `chosen`, all points at once.

    Each point begins where the covariance says that the others go when one is moved (a warm start). Only
    points that came to their end count: others would show too steep a profile. None is begun out of time.

    Args:
        best: coordinates and cost of the estimate.
        sure: of the estimate.
    """
    u, cost = best
    if not len(chosen):
        return []
    points = [(i, t) for i in chosen for t in STEPS_OUT]
    starts = np.stack([_moved(u, sure, i, t) for i, t in points])
    starts = np.clip(starts, limits.lower, limits.upper)
    held = np.zeros(starts.shape, dtype=bool)
    held[np.arange(len(points)), [i for i, _ in points]] = True
    lanes = descend(evaluate, starts, limits, held) if time.monotonic() < limits.deadline else []
    found = []
    for i in chosen:
        own = [lane for lane, (j, _) in zip(lanes, points, strict=False) if j == i]
        found.append(_profile(unknowns, u, cost, sure, i, [lane for lane in own if lane.code in ENDED]))
    return found


def _moved(u: NDArray[np.float64], sure: Covariance, i: int, t: float) -> NDArray[np.float64]:
    size = np.where(np.isfinite(sure.std), sure.std, OPEN_STEP)
    return u + t * sure.correlations[:, i] * size


def _profile(
    unknowns: Unknowns, u: NDArray[np.float64], cost: float, sure: Covariance, i: int, lanes: Sequence[Lane]
) -> Profile:
    known = 0 < sure.std[i] < np.inf
    excess = (sure.std[i] / sure.assumed[i]) ** 2 if known else 1.0
    at = np.array([u[i], *(lane.u[i] for lane in lanes)])
    deviance = np.array([0.0, *(2 * (lane.cost - cost) / excess for lane in lanes)])
    at, first = np.unique(at, return_index=True)  # several points are one at a bound
    deviance = deviance[first]
    signed = np.sign(at - u[i]) * np.sqrt(np.maximum(deviance, 0.0))
    table = np.tile(u, (len(at), 1))
    table[:, i] = at
    lower, upper = (_crossing(at, signed, side * QUANTILE) for side in (-1.0, 1.0))
    ends = np.tile(u, (2, 1))
    ends[:, i] = np.nan_to_num([lower, upper], nan=u[i])
    low, high = unknowns.values(ends)[:, i]
    entry = unknowns.entries[i]
    # Without a crossing the interval goes on to a bound that was reached, else nobody knows how far.
    beneath = entry.lower if at[0] <= unknowns.lower[i] else -np.inf
    above = entry.upper if at[-1] >= unknowns.upper[i] else np.inf
    return Profile(
        unknowns.names[i],
        unknowns.values(table)[:, i],
        deviance,
        beneath if np.isnan(lower) else float(low),
        above if np.isnan(upper) else float(high),
        len(STEPS_OUT) - len(lanes),
    )


def _crossing(at: NDArray[np.float64], signed: NDArray[np.float64], level: float) -> float:
    """Where the signed root of the deviance has a value; NaN if nowhere."""
    outside = np.flatnonzero(signed >= level) if level > 0 else np.flatnonzero(signed <= level)
    if not outside.size:
        return float("nan")
    far = int(outside[0] if level > 0 else outside[-1])
    near = far - 1 if level > 0 else far + 1
    part = (level - signed[near]) / (signed[far] - signed[near])
    return float(at[near] + part * (at[far] - at[near]))
