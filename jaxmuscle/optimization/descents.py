"""Descents from many starts: each start's way so far, when it ends, and the best of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

Vector = NDArray[np.float64]

CONVERGED, STALLED, STEPS, BUDGET, FAILED = "converged", "stalled", "steps", "budget", "failed"
"""How a descent ended: at a minimum; where no step lowers the cost; out of steps; out of time; nowhere."""
OUT_OF_REACH = "out of reach"
"""It ended where the goal that it was given lay too far below."""
BROKEN = 1e4
"""Residual that stands for a prediction that is not a number: large, but no end to the fit."""
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
        goal, reach: cost that is of use, and how many times the fall that the quadratic model expects it may
            lie below; a descent that is farther away ends (:data:`OUT_OF_REACH`).
        enough: expected fall of the cost at which a descent may end, and what `patience` steps have to bring.
    """

    near: float = 1e-3
    noticeable: float = 0.02
    patience: int = 8
    exact: float = 1e-6
    fall: float = 0.0
    slow: float = 0.0
    floor: float = 0.0
    least: float = 0.0
    goal: float = np.inf
    reach: float = 2.0
    enough: float = 0.0

    def beyond_noise(self, cost: float) -> float:
        """Cost of which `fall` and `slow` are parts."""
        return max(cost - self.floor, min(self.least, cost))


@dataclasses.dataclass(frozen=True)
class Limits:
    """Bounds of the coordinates, steps of a lane, lanes at a time, and when to stop (`time.monotonic`).

    Attributes:
        samples: number of residuals, by which the cost is judged.
        reach: how far a coordinate may go in one step, relative to the longest step of a logarithm.
        best_first: whether all starts are looked at before any descent goes on, the cheapest ones first.
        solver: what takes the outcome of a trial into its lane and sets the next trial, or the end; our own
            trust region (:mod:`jaxmuscle.optimization.levenberg_marquardt`) when `None`.
    """

    lower: Vector
    upper: Vector
    steps: int
    lanes: int
    deadline: float = np.inf
    samples: int = 1
    reach: Vector | float = 1.0
    tolerances: Tolerances = Tolerances()
    best_first: bool = False
    solver: Callable[[Lane, Local, Limits], None] | None = None

    @cached_property
    def longest(self) -> Vector:
        """Largest change of each coordinate in one step."""
        return LONGEST_STEP * np.broadcast_to(self.reach, self.lower.shape)


def best(lanes: Sequence[Lane]) -> Lane | None:
    """The lane of lowest cost that has not failed; `None` when all have."""
    sound = [lane for lane in lanes if lane.code != FAILED]
    return min(sound, key=lambda lane: lane.cost) if sound else None


def scale(lane: Lane, limits: Limits) -> float:
    """Mean square residual at the best point so far, in which changes of the cost are judged."""
    return max(2 * lane.cost / max(limits.samples, 1), limits.tolerances.exact)
