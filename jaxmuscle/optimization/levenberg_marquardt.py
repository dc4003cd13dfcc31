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

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

Vector = NDArray[np.float64]

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


CONVERGED, STALLED, STEPS, BUDGET, FAILED = "converged", "stalled", "steps", "budget", "failed"
"""How a descent ended: at a minimum; where no step lowers the cost; out of steps; out of time; nowhere."""
LONGEST_STEP = 1.5
"""Largest change of a logarithm in one step: a factor of 4.5."""


@dataclasses.dataclass(frozen=True)
class Local:
    """Cost, gradient and Gauss-Newton matrix at one point; how many predictions are not numbers there."""

    cost: float
    gradient: Float[np.ndarray, " k"]
    matrix: Float[np.ndarray, "k k"]
    broken: int

    @property
    def finite(self) -> bool:
        """Whether cost, gradient and matrix are numbers."""
        with np.errstate(invalid="ignore", over="ignore"):
            return math.isfinite(self.cost + self.gradient.sum() + self.matrix.sum())


@dataclasses.dataclass(eq=False)
class Lane:
    """One start and how far it has come.

    Attributes:
        held: coordinates that stay as they are.
        local, trial: what is known at u, and where to look next.
        radius, size: longest step that is trusted and the last one, each coordinate in units of the largest
            curvature so far, which is `curvature`.
        expected: fall of the cost that the quadratic model promises of the trial.
        costs: of the best point so far, after each evaluation.
        memory: what a solver other than our own keeps from one step to the next.
    """

    start: Vector
    held: NDArray[np.bool_]
    u: Vector
    code: str = STEPS
    reason: str = ""
    local: Local | None = None
    trial: Vector | None = None
    expected: float = 0.0
    radius: float = np.inf
    size: float = 0.0
    curvature: Vector | None = None
    steps: int = 0
    rejected: int = 0
    costs: list[float] = dataclasses.field(default_factory=list)
    memory: Any = None

    @property
    def cost(self) -> float:
        """Cost at the best point so far."""
        return np.inf if self.local is None else self.local.cost

    def begin(self, local: Local, limits: Limits) -> bool:
        """Take in what is known at the start; whether there is anything to descend on."""
        self.trial, self.local = None, local
        if local.finite and local.broken <= 0.5 * limits.samples:
            return True
        self.fail("no finite prediction at its start")
        return False

    def end(self, code: str) -> None:
        """Try nothing more; a point at which predictions are not numbers has failed."""
        self.trial, self.code = None, code
        if self.local is not None and self.local.broken:
            self.fail("predictions that are not numbers at its end")

    def fail(self, reason: str) -> None:
        """Give up; the reason is told to the user."""
        self.trial, self.code, self.reason = None, FAILED, reason


@dataclasses.dataclass(frozen=True)
class Course:
    """What a progress report holds: iteration, best cost so far, lanes under way, waiting and ended."""

    iteration: int
    cost: float
    active: int
    waiting: int
    ended: int


@dataclasses.dataclass(frozen=True)
class Tolerances:
    """When a descent of our own ends; costs are per mean square residual, which is at least `exact`.

    The defaults are those of a fit to noisy data, whose residuals are in units of the noise.

    Attributes:
        near: fall of the cost that the quadratic model expects at most at a minimum. By default 0.05
            standard deviations away.
        noticeable, patience: fall of the cost that so many steps, taken or rejected, have to bring.
        exact: mean square residual below which a fit counts as exact.
        fall: expected fall relative to the cost above `floor` at which a descent may end before its minimum.
        slow: fall over `patience` steps relative to the same at which it may.
        floor, least: cost that the noise alone leaves, and how much beyond it counts at least, if there is
            so much at all.
    """

    near: float = 1e-3
    noticeable: float = 0.02
    patience: int = 8
    exact: float = 1e-6
    fall: float = 0.0
    slow: float = 0.0
    floor: float = 0.0
    least: float = 0.0

    def beyond_noise(self, cost: float) -> float:
        """Cost of which `fall` and `slow` are parts."""
        return max(cost - self.floor, min(self.least, cost))


@dataclasses.dataclass(frozen=True)
class Limits:
    """Bounds of the coordinates, steps of a lane, lanes at a time, and when to stop (`time.monotonic`).

    Attributes:
        samples: number of residuals, by which the cost is judged.
        reach: how far a coordinate may go in one step, relative to the longest step of a logarithm.
        solver: what takes the outcome of a trial into its lane and sets the next trial, or the end; our own
            trust region (:func:`advance`) when `None`.
    """

    lower: Vector
    upper: Vector
    steps: int
    lanes: int
    deadline: float = np.inf
    samples: int = 1
    reach: Vector | float = 1.0
    tolerances: Tolerances = Tolerances()
    solver: Callable[[Lane, Local, Limits], None] | None = None

    @cached_property
    def longest(self) -> Vector:
        """Largest change of each coordinate in one step."""
        return LONGEST_STEP * np.broadcast_to(self.reach, self.lower.shape)


def best(lanes: Sequence[Lane]) -> Lane | None:
    """The lane of lowest cost that has not failed; `None` when all have."""
    sound = [lane for lane in lanes if lane.code != FAILED]
    return min(sound, key=lambda lane: lane.cost) if sound else None


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
    ends = limits.tolerances
    if len(lane.costs) <= ends.patience:
        return False
    noticeable = max(ends.noticeable * scale(lane, limits), ends.slow * ends.beyond_noise(lane.cost))
    return lane.costs[-1 - ends.patience] - lane.cost < noticeable


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
    ends = limits.tolerances
    near = max(ends.near * scale(lane, limits), ends.fall * ends.beyond_noise(lane.cost))
    if model is None or model.fall <= near:
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

    At most `limits.lanes` are under way at a time. A step minimises the quadratic model within a radius, in
    which coordinates count by diag(JᵀJ) (Marquardt 1963; Moré 1978); a coordinate at a bound that the
    gradient pushes on is left out.
    """
    keep = np.zeros(starts.shape, dtype=bool) if held is None else held
    lanes = [Lane(u.copy(), h, u.copy(), trial=u.copy()) for u, h in zip(starts, keep, strict=True)]
    waiting = iter(lanes)
    active: list[Lane] = []
    for iteration in _forever():
        active += _next(waiting, limits.lanes - len(active))
        if not active:
            break
        if iteration and time.monotonic() > limits.deadline:
            for lane in lanes:
                if lane in active or lane.local is None:
                    lane.code, lane.reason = (
                        (FAILED, "not begun in time") if lane.local is None else (BUDGET, "")
                    )
            break
        trials = [lane.trial for lane in active if lane.trial is not None]
        for lane, local in zip(active, evaluate(np.stack(trials)), strict=True):
            (limits.solver or advance)(lane, local, limits)
        active = [lane for lane in active if lane.trial is not None]
        begun = sum(lane.local is not None or lane.code == FAILED for lane in lanes)
        best = min((lane.cost for lane in lanes if lane.code != FAILED), default=np.inf)
        tell(Course(iteration, best, len(active), len(lanes) - begun, begun - len(active)))
    return lanes


def _forever() -> Iterator[int]:
    number = 0
    while True:
        yield number
        number += 1


def _next(waiting: Iterator[Lane], count: int) -> list[Lane]:
    return [lane for _, lane in zip(range(count), waiting, strict=False)]
