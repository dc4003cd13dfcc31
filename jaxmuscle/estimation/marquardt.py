"""One start of a Levenberg-Marquardt descent: its next trial within bounds, or a reason for its end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.lane import CONVERGED, FAILED, STALLED, STEPS, Lane, Limits
from jaxmuscle.estimation.objective import Local

Vector = NDArray[np.float64]

NEAR = 1e-3
"""Expected fall of the cost, per mean square residual, at a minimum: 0.05 standard deviations away."""
EXACT = 1e-6
"""Mean square residual, in units of the noise, below which a fit counts as exact."""
REJECTIONS = 10
"""Steps rejected in a row after which no further one is tried."""
PATIENCE = 8
"""Steps, taken or rejected, over which the cost has to fall noticeably."""
NOTICEABLE = 0.02
"""Fall of the cost over them, per mean square residual, that is."""
SOFTER = 0.1
"""Least factor by which a step that went well lowers the damping."""


def advance(lane: Lane, local: Local, limits: Limits) -> None:
    """Take the outcome of a trial into a lane and decide on its next one, or on its end."""
    finite = np.isfinite(local.cost) and np.isfinite(local.gradient).all() and np.isfinite(local.matrix).all()
    if lane.local is None:
        lane.trial, lane.local = None, local
        if not finite or local.broken > 0.5 * limits.samples:
            _fail(lane, "no finite prediction at its start")
            return
        lane.curvature = np.diag(local.matrix).copy()
    elif not _accepted(lane, local, bool(finite)):
        lane.rejected += 1
    lane.costs.append(lane.cost)
    if lane.rejected >= REJECTIONS or _tired(lane, limits):
        _end(lane, STALLED)
        return
    if lane.steps >= limits.steps:
        _end(lane, STEPS)
        return
    _propose(lane, limits)


def _accepted(lane: Lane, local: Local, finite: bool) -> bool:
    assert lane.local is not None and lane.trial is not None and lane.curvature is not None
    lane.steps += 1
    gain = lane.local.cost - local.cost if finite else -np.inf
    ratio = gain / lane.expected if lane.expected > 0 else -np.inf
    if not ratio > 1e-4:
        lane.damping, lane.growth = lane.damping * lane.growth, 2 * lane.growth
        return False
    lane.u, lane.local, lane.rejected, lane.growth = lane.trial, local, 0, 2.0
    lane.damping = max(lane.damping * max(SOFTER, 1 - (2 * min(ratio, 2.0) - 1) ** 3), 1e-15)
    lane.curvature = np.maximum(lane.curvature, np.diag(local.matrix))
    return True


def _tired(lane: Lane, limits: Limits) -> bool:
    """Whether the cost has hardly fallen for a while: it is rugged, and its slopes lead nowhere."""
    if len(lane.costs) <= PATIENCE:
        return False
    return lane.costs[-1 - PATIENCE] - lane.cost < NOTICEABLE * _scale(lane, limits)


def _scale(lane: Lane, limits: Limits) -> float:
    """Mean square residual in units of the noise."""
    return max(2 * lane.cost / max(limits.samples, 1), EXACT)


def _propose(lane: Lane, limits: Limits) -> None:
    """The next trial, or the end when the minimum is near."""
    assert lane.local is not None and lane.curvature is not None
    g, matrix = lane.local.gradient, lane.local.matrix
    stuck = ((lane.u <= limits.lower) & (g > 0)) | ((lane.u >= limits.upper) & (g < 0))
    free = np.flatnonzero(~(lane.held | stuck) & (np.diag(matrix) > 0))
    inner, slope = matrix[np.ix_(free, free)], g[free]
    if not len(free) or _decrement(inner, slope) <= NEAR * _scale(lane, limits):
        _end(lane, CONVERGED)
        return
    damped = inner + lane.damping * np.diag(lane.curvature[free])
    step = np.zeros_like(g)
    step[free] = np.clip(-np.linalg.solve(damped, slope), -limits.longest[free], limits.longest[free])
    lane.trial = np.clip(lane.u + step, limits.lower, limits.upper)
    moved = lane.trial - lane.u
    lane.expected = float(-(g @ moved) - 0.5 * moved @ matrix @ moved)
    if not lane.expected > 0:
        # Clipped at a bound, the step need not go downhill; a shorter one does.
        lane.damping *= lane.growth


def _decrement(matrix: NDArray[np.float64], slope: Vector) -> float:
    """Fall of the cost that the quadratic model expects of its own minimum: gᵀH⁻¹g/2."""
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size) + 1e-12 * np.eye(len(size))
    return float(0.5 * (slope / size) @ np.linalg.solve(scaled, slope / size))


def _end(lane: Lane, code: str) -> None:
    lane.trial, lane.code = None, code
    if lane.local is not None and lane.local.broken:
        _fail(lane, "predictions that are not numbers at its end")


def _fail(lane: Lane, reason: str) -> None:
    lane.trial, lane.code, lane.reason = None, FAILED, reason
