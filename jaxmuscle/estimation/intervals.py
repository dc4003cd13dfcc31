"""Confidence intervals of fitted values: profile likelihood, values at a bound, conflict with the prior."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.covariance import Covariance, Minimum
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.optimization.descents import CONVERGED, STALLED, Lane, Limits, Local
from jaxmuscle.optimization.levenberg_marquardt import descend
from jaxmuscle.parameters import Declaration

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted(Declaration):
    """One fitted value (SI) of what is declared.

    Attributes:
        std: the largest of `independent`, `coloured`, `windows` and `states`, see
            :func:`jaxmuscle.estimation.covariance.covariance`; 0 at a bound.
        prior: mean and standard deviation of what was known beforehand.
        at_bound: "lower" or "upper" when the value ended there.
        recording: name of the recording whose own it is, `None` for one of all recordings.
        inner: end of the 95 % interval of a value at a bound; `None` for others.
        conflict: distance between the prior and what the data say without it, in standard deviations of
            their difference; 0 unless they contradict each other.
    """

    value: float
    std: float
    path: str
    start: float
    lower: float
    upper: float
    independent: float
    coloured: float
    windows: float
    prior: tuple[float, float] | None = None
    at_bound: str | None = None
    recording: str | None = None
    states: float = 0.0
    inner: float | None = None
    conflict: float = 0.0

    def interval(self) -> tuple[float, float]:
        """95 % confidence interval; of a positive parameter on the logarithm, and within the bounds.

        A value at a bound is one end of it.
        """
        if self.inner is not None:
            return min(self.value, self.inner), max(self.value, self.inner)
        reach = QUANTILE * self.std
        if self.positive and math.isfinite(reach):
            # A factor beyond e^700 is as good as infinite, and no number.
            factor = math.exp(min(reach / self.value, 700.0))
            low, high = self.value / factor, self.value * factor
        else:
            low, high = self.value - reach, self.value + reach
        return max(low, self.lower), min(high, self.upper)


@dataclasses.dataclass(frozen=True)
class StartOutcome:
    """One start: its values, where it ended, its cost there, and how; `reason` why it failed."""

    start: dict[str, float]
    end: dict[str, float]
    cost: float
    code: str
    reason: str
    steps: int
    reached: bool


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise of one column (SI).

    Attributes:
        assumed: of the sensor.
        residual: root mean square residual.
        ratio: root mean square of the residuals over what was expected of each: the sensor's noise, and
            what the smoothed states that predictions begin from leave uncertain; residuals weighted as the
            loss does, so that outliers hardly count under a robust one; 1 for normal noise under any loss.
    """

    assumed: float
    residual: float
    ratio: float
    autocorrelation_time: float
    unit: str


def with_inner_ends(parameters: Mapping[str, Fitted], minimum: Minimum) -> dict[str, Fitted]:
    r"""The parameters, with the inner end of the interval of each that is at a bound.

    The likelihood ratio on the allowed side: inwards by t the deviance rises by :math:`(2 g t + h t^2)/e`,
    g the slope of the cost there, h its curvature with the others fitted anew (those at bounds of their own
    left there), e the excess of the variance over that of independent residuals. It is 3.84 where the
    interval ends. Intervals of 95 % hold a truth at the bound, or near it, at least as often as that
    (Self and Liang 1987, case 5).
    """
    found, unknowns, u, ends = dict(parameters), minimum.unknowns, minimum.u, minimum.ends
    for i in np.flatnonzero(ends):
        sure = minimum.covariance(minimum.held & (np.arange(len(u)) != i))
        scored = [
            line.slopes[i] @ (minimum.loss.weight(line.residual) * line.residual) for line in minimum.lines
        ]
        slope = float(sum(scored))
        slope += float(unknowns.prior_residuals(u)[i] * unknowns.prior_slopes[i])
        # Where the minimum would be without the bound: so far outside.
        outside = -ends[i] * slope * sure.assumed[i] ** 2
        inside = float(np.hypot(outside, QUANTILE * sure.std[i]) - outside)
        moved = u.copy()
        moved[i] = np.clip(u[i] - ends[i] * inside, unknowns.lower[i], unknowns.upper[i])
        name = unknowns.names[i]
        found[name] = dataclasses.replace(found[name], inner=float(unknowns.values(moved)[i]))
    return found


Vector = NDArray[np.float64]

CONTRADICTED = 4.0
"""Distance of a prior from the data, in standard deviations of their difference, that contradicts."""
HEARD, NEAR = 4e-4, 0.2
"""Part of a prior's variance that the data take away below which a value this near to the prior's mean, in
its standard deviations, is not judged: a fit ends within a twentieth of one from the minimum."""


def with_conflicts(parameters: Mapping[str, Fitted], minimum: Minimum) -> dict[str, Fitted]:
    r"""The parameters, with the conflict of each prior that is contradicted.

    A value that moved from its prior's mean by d is :math:`d / \sqrt{s^2 - p^2}` standard deviations off, s
    that of the prior, p that of the fit (Evans and Moshonov 2006; Presanis et al. 2013): however narrow the
    prior is. Where that is much, the fit without this prior is looked at, one linear step away, with the
    residuals that it has: those beside a contradicted prior go together and would hide the conflict.
    """
    found, unknowns, u = dict(parameters), minimum.unknowns, minimum.u
    free = np.flatnonzero(~minimum.held)
    away, sharpness = unknowns.prior_residuals(u), unknowns.prior_slopes
    matrix, gradient = np.diag(sharpness**2), away * sharpness
    for line in minimum.lines:
        weighted = minimum.loss.weighted(line.slopes, line.residual)
        matrix, gradient = matrix + weighted @ line.slopes.T, gradient + weighted @ line.residual
    inner = free[:, None], free
    known = np.diag(np.linalg.pinv(matrix[inner], hermitian=True))
    for i, variance in zip(free, known, strict=True):
        heard = 1 - sharpness[i] ** 2 * variance
        unsure = heard < HEARD and abs(away[i]) < NEAR
        if sharpness[i] == 0 or unsure or abs(away[i]) <= CONTRADICTED * np.sqrt(max(heard, 0.0)):
            continue
        own = np.arange(len(u)) == i
        rest, step = matrix - np.diag(own * sharpness**2), np.zeros(len(u))
        step[free] = -np.linalg.pinv(rest[inner], hermitian=True) @ (gradient - own * away * sharpness)[free]
        alone = _without_prior(minimum, int(i), step).covariance().std[i]
        far = abs(away[i] + sharpness[i] * step[i]) / np.hypot(1.0, sharpness[i] * alone)
        if far > CONTRADICTED:
            name = unknowns.names[i]
            found[name] = dataclasses.replace(found[name], conflict=float(far))
    return found


def _without_prior(minimum: Minimum, i: int, step: Vector) -> Minimum:
    """A linear step away, and without the prior of the i-th unknown."""
    lines = [dataclasses.replace(x, residual=x.residual + step @ x.slopes * x.counts) for x in minimum.lines]
    entries = list(minimum.unknowns.entries)
    entries[i] = dataclasses.replace(entries[i], prior=None)
    return dataclasses.replace(minimum, lines=lines, unknowns=Unknowns(entries))
