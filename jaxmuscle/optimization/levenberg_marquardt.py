"""Levenberg-Marquardt method within bounds, for many starts at once, by trust regions.

The damping is what keeps a step within a radius (Moré 1978): near a minimum there is none, and a
Gauss-Newton step goes all the way along directions that the data hardly tell.

Our own beside optimistix, which steps one start, knows no bounds, and, compiled as a whole, cannot be stopped
by a deadline. Measured on two cores that others used too (a muscle that lifts a mass, 850 samples, four
parameters up to 40 % off): from one start 5 evaluations of residuals and Jacobian to the minimum;
`optimistix.LevenbergMarquardt` with the simulation in its program 6, but 22 s to compile it, where the
program here takes 11 s and serves all starts and stages. Twenty starts: 97 evaluations in 6 iterations,
0.06 s; by the steps of optimistix on the same program (`optimistix_solver`) 260 in 42, 0.6 s.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float

from jaxmuscle.optimization.descents import (
    BUDGET,
    CONVERGED,
    FAILED,
    OUT_OF_REACH,
    STALLED,
    STEPS,
    Course,
    Lane,
    Limits,
    Local,
    Vector,
    scale,
)

ROUNDING = 1e-13
"""Curvature along a combination of coordinates, relative to the largest, below which it is rounding."""
NEWTON, RADIUS_TOLERANCE = 30, 0.05
"""Iterations at most, and how far beyond its radius a step still counts as long as it."""


class Quadratic:
    r"""The model :math:`g^T p + \frac12 p^T H p` with each coordinate in units of 1/`unit`."""

    def __init__(self, matrix: Float[np.ndarray, "k k"], gradient: Vector, unit: Vector) -> None:
        """H, positive semidefinite; g; and what coordinates are multiplied by."""
        curvatures, self._axes = np.linalg.eigh(matrix / (unit[:, None] * unit))
        self._curvatures = np.maximum(curvatures, ROUNDING * curvatures[-1])
        self._along = self._axes.T @ (gradient / unit)
        self._unit = unit

    @property
    def fall(self) -> float:
        """By how much the model falls to its minimum: gᵀH⁻¹g/2."""
        return 0.5 * float(self._along @ (self._along / self._curvatures))

    def damped(self, damping: float) -> Vector:
        """The step with (H + λ unit²) p = -g (Marquardt 1963)."""
        return -self._axes @ (self._along / (self._curvatures + damping)) / self._unit

    def within(self, radius: float) -> Vector:
        """The step of at most this length, in units, that lowers the model most.

        Newton's method for the damping at which the step is as long as the radius (Hebden 1973; Moré 1978,
        "The Levenberg-Marquardt algorithm", equation 5.5).
        """
        damping, step, size = 0.0, self._along, np.inf
        for _ in range(NEWTON):
            step = self._along / (self._curvatures + damping)
            size = float(np.sqrt(step @ step))
            if size <= radius * (1 + RADIUS_TOLERANCE):
                break
            slope = float(step @ (step / (self._curvatures + damping)))
            damping += (size / radius - 1) * size**2 / slope
        return -self._axes @ (step * min(1.0, radius / size if size > 0 else 1.0)) / self._unit


FIRST_DAMPING = 1e-2
"""Damping of the first step, relative to the diagonal of the Gauss-Newton matrix: it sets the radius."""
REJECTIONS = 10
"""Steps rejected in a row after which no further one is tried."""
LEAST_FALL = 1e-4
"""Fall of the cost over what was expected from which on a step is taken."""
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
        if not begun(lane, local, limits):
            return
    else:
        taken(lane, local)
    proceed(lane, limits)


def begun(lane: Lane, local: Local, limits: Limits) -> bool:
    """Take in what is known at the start; whether there is anything to descend on."""
    if lane.begin(local, limits):
        lane.curvature = local.matrix.diagonal().copy()
        return True
    return False


def proceed(lane: Lane, limits: Limits) -> None:
    """Decide on the next trial of a lane, or on its end."""
    lane.costs.append(lane.cost)
    if lane.rejected >= REJECTIONS or _tired(lane, limits):
        lane.end(STALLED)
        return
    if lane.steps >= limits.steps:
        lane.end(STEPS)
        return
    _propose(lane, limits)


def taken(lane: Lane, local: Local) -> float:
    """Take in the outcome of a trial: the fall of the cost over what was expected, above
    :data:`LEAST_FALL` where the lane has moved on to it.
    """
    assert lane.local is not None and lane.trial is not None and lane.curvature is not None
    lane.steps += 1
    gain = lane.local.cost - local.cost if local.finite else -np.inf
    ratio = gain / lane.expected if lane.expected > 0 else -np.inf
    if ratio < POOR:
        lane.radius = SHRINK * lane.size
    elif ratio > GOOD and lane.size > FILLED * lane.radius and not lane.rejected:
        lane.radius *= GROW
    if ratio > LEAST_FALL:
        lane.u, lane.local, lane.rejected = lane.trial, local, 0
        lane.curvature = np.maximum(lane.curvature, local.matrix.diagonal())
    else:
        lane.rejected += 1
    return ratio


def _tired(lane: Lane, limits: Limits) -> bool:
    """Whether the cost has hardly fallen for a while: it is rugged, and its slopes lead nowhere."""
    ends = limits.tolerances
    if len(lane.costs) <= ends.patience:
        return False
    relative = ends.slow * ends.beyond_noise(lane.cost)
    noticeable = max(ends.noticeable * scale(lane, limits), relative, ends.enough)
    return lane.costs[-1 - ends.patience] - lane.cost < noticeable


def _propose(lane: Lane, limits: Limits) -> None:
    """The next trial, or the end when the minimum is near."""
    assert lane.local is not None and lane.curvature is not None
    g, matrix = lane.local.gradient, lane.local.matrix
    stuck = ((lane.u <= limits.lower) & (g > 0)) | ((lane.u >= limits.upper) & (g < 0))
    free = ~(lane.held | stuck) & (matrix.diagonal() > 0)
    model = Quadratic(matrix[free][:, free], g[free], np.sqrt(lane.curvature[free])) if free.any() else None
    ends = limits.tolerances
    near = max(ends.near * scale(lane, limits), ends.fall * ends.beyond_noise(lane.cost), ends.enough)
    if model is None or model.fall <= near:
        lane.end(CONVERGED)
        return
    if lane.cost - ends.reach * model.fall > ends.goal:
        lane.end(OUT_OF_REACH)
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
    if lane.size == 0:  # Rejected steps have become shorter than numbers tell apart, or bounds allow none.
        lane.end(STALLED)
        return
    lane.radius = lane.size if first else lane.radius
    # Clipped at a bound, a step need not go downhill: it is then rejected, and a shorter one is.
    lane.expected = float(-(g @ moved) - 0.5 * moved @ matrix @ moved)


def descend(
    evaluate: Callable[[Float[np.ndarray, "lanes k"]], list[Local]],
    starts: Float[np.ndarray, "starts k"],
    limits: Limits,
    held: Bool[np.ndarray, "starts k"] | None = None,
    tell: Callable[[Course], None] = lambda course: None,
) -> list[Lane]:
    """Descend from every start; as soon as one lane has ended the next start takes its place.

    At most `limits.lanes` are under way at a time; with `limits.best_first` all starts are looked at, and the
    cheapest go first. A step minimises the quadratic model within a radius, in
    which coordinates count by diag(JᵀJ) (Marquardt 1963; Moré 1978); a coordinate at a bound that the
    gradient pushes on is left out.
    """
    keep = np.zeros(starts.shape, dtype=bool) if held is None else held
    lanes = [Lane(u.copy(), h, u.copy(), trial=u.copy()) for u, h in zip(starts, keep, strict=True)]
    waiting = iter(lanes)
    active: list[Lane] = []
    for iteration in _forever():
        room = len(lanes) if limits.best_first and not iteration else limits.lanes
        active += _next(waiting, room - len(active))
        if not active:
            break
        if iteration and time.monotonic() > limits.deadline:
            for lane in lanes:
                if lane.trial is not None:
                    lane.code, lane.reason = (
                        (FAILED, "not begun in time") if lane.local is None else (BUDGET, "")
                    )
            break
        trials = [lane.trial for lane in active if lane.trial is not None]
        for lane, local in zip(active, evaluate(np.stack(trials)), strict=True):
            (limits.solver or advance)(lane, local, limits)
        active = [lane for lane in active if lane.trial is not None]
        if limits.best_first and not iteration:
            active.sort(key=lambda lane: lane.cost)
            waiting = iter(active[limits.lanes :])
            active = active[: limits.lanes]
        ended = sum(lane.trial is None for lane in lanes)
        best = min((lane.cost for lane in lanes if lane.code != FAILED), default=np.inf)
        tell(Course(iteration, best, len(active), len(lanes) - ended - len(active), ended))
    return lanes


def _forever() -> Iterator[int]:
    number = 0
    while True:
        yield number
        number += 1


def _next(waiting: Iterator[Lane], count: int) -> list[Lane]:
    return [lane for _, lane in zip(range(count), waiting, strict=False)]
