"""One start of a Levenberg-Marquardt descent: its next trial within bounds, or a reason for its end.

The damping is what keeps a step within a radius (Moré 1978): near a minimum there is none, and a
Gauss-Newton step goes all the way along directions that the data hardly tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.lane import CONVERGED, STALLED, STEPS, Lane, Limits, Local
from jaxmuscle.estimation.quadratic import Quadratic

Vector = NDArray[np.float64]

FIRST_DAMPING = 1e-2
"""Damping of the first step, relative to the diagonal of the Gauss-Newton matrix: it sets the radius."""
REJECTIONS = 10
"""Steps rejected in a row after which no further one is tried."""
POOR, GOOD = 0.25, 0.75
"""Fall of the cost over what was expected, below which a radius shrinks and above which it grows."""
SHRINK, GROW = 0.25, 2.0
"""Factors by which a radius shrinks, relative to the step, and grows."""
RESOLUTION = 1e-11
"""Step of a coordinate, relative to it and to 1, that is rounding."""
FILLED = 0.9
"""Part of its radius from which a step has been kept short by it."""


def advance(lane: Lane, local: Local, limits: Limits) -> None:
    """Take the outcome of a trial into a lane and decide on its next one, or on its end."""
    if lane.local is None:
        if not lane.begin(local, limits):
            return
        lane.curvature = local.matrix.diagonal().copy()
    elif not _accepted(lane, local):
        lane.rejected += 1
    elif lane.cost > (1 - limits.tolerances.fall) * lane.costs[-1]:
        lane.end(CONVERGED)
        return
    lane.costs.append(lane.cost)
    if lane.rejected >= REJECTIONS or _tired(lane, limits):
        lane.end(STALLED)
        return
    if lane.steps >= limits.steps:
        lane.end(STEPS)
        return
    _propose(lane, limits)


def _accepted(lane: Lane, local: Local) -> bool:
    assert lane.local is not None and lane.trial is not None and lane.curvature is not None
    lane.steps += 1
    gain = lane.local.cost - local.cost if local.finite else -np.inf
    ratio = gain / lane.expected if lane.expected > 0 else -np.inf
    if ratio < POOR:
        lane.radius = SHRINK * lane.size
    elif ratio > GOOD and lane.size > FILLED * lane.radius and not lane.rejected:
        lane.radius *= GROW
    if not ratio > 1e-4:
        return False
    lane.u, lane.local, lane.rejected = lane.trial, local, 0
    lane.curvature = np.maximum(lane.curvature, local.matrix.diagonal())
    return True


def _tired(lane: Lane, limits: Limits) -> bool:
    """Whether the cost has hardly fallen for a while: it is rugged, and its slopes lead nowhere."""
    patience, noticeable = limits.tolerances.patience, limits.tolerances.noticeable
    if len(lane.costs) <= patience:
        return False
    return lane.costs[-1 - patience] - lane.cost < noticeable * scale(lane, limits)


def scale(lane: Lane, limits: Limits) -> float:
    """Mean square residual at the best point so far, in which changes of the cost are judged."""
    return max(2 * lane.cost / max(limits.samples, 1), limits.tolerances.exact)


def _propose(lane: Lane, limits: Limits) -> None:
    """The next trial, or the end when the minimum is near."""
    assert lane.local is not None and lane.curvature is not None
    g, matrix = lane.local.gradient, lane.local.matrix
    stuck = ((lane.u <= limits.lower) & (g > 0)) | ((lane.u >= limits.upper) & (g < 0))
    free = ~(lane.held | stuck) & (matrix.diagonal() > 0)
    model = Quadratic(matrix[free][:, free], g[free], np.sqrt(lane.curvature[free])) if free.any() else None
    if model is None or model.fall <= limits.tolerances.near * scale(lane, limits):
        lane.end(CONVERGED)
        return
    first = lane.radius == np.inf
    best = model.damped(FIRST_DAMPING) if first else model.within(lane.radius)
    step = np.zeros_like(g)
    step[free] = best
    step = np.minimum(np.maximum(step, -limits.longest), limits.longest)
    lane.trial = np.minimum(np.maximum(lane.u + step, limits.lower), limits.upper)
    moved = lane.trial - lane.u
    if not lane.rejected and (np.abs(moved) <= RESOLUTION * (1 + np.abs(lane.u))).all():
        lane.end(CONVERGED)
        return
    lane.size = float(np.sqrt(moved**2 @ lane.curvature))
    lane.radius = lane.size if first else lane.radius
    # Clipped at a bound, a step need not go downhill: it is then rejected, and a shorter one is.
    lane.expected = float(-(g @ moved) - 0.5 * moved @ matrix @ moved)
