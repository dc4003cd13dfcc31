"""One start of a fit on its way down, and what limits all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Local

Vector = NDArray[np.float64]

CONVERGED, STALLED, STEPS, BUDGET, FAILED = "converged", "stalled", "steps", "budget", "failed"
"""How a descent ended: at a minimum; where no step lowers the cost; out of steps; out of time; nowhere."""
LONGEST_STEP = 1.5
"""Largest change of a logarithm in one step: a factor of 4.5."""


@dataclasses.dataclass(eq=False)
class Lane:
    """One start and how far it has come.

    Attributes:
        held: coordinates that stay as they are.
        local, trial: what is known at u, and where to look next.
        radius, size: longest step that is trusted and the last one, each coordinate in units of the largest
            curvature so far, which is `curvature`.
        expected: fall of the cost that the quadratic model promises of the trial.
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

    @property
    def cost(self) -> float:
        """Cost at the best point so far."""
        return np.inf if self.local is None else self.local.cost


@dataclasses.dataclass(frozen=True)
class Course:
    """What a progress report holds: iteration, best cost so far, lanes under way, waiting and ended."""

    iteration: int
    cost: float
    active: int
    waiting: int
    ended: int


@dataclasses.dataclass(frozen=True)
class Limits:
    """Bounds of the coordinates, steps of a lane, lanes at a time, and when to stop (`time.monotonic`).

    `reach`: how far a coordinate may go in one step, relative to the longest step of a logarithm.
    """

    lower: Vector
    upper: Vector
    steps: int
    lanes: int
    deadline: float = np.inf
    samples: int = 1
    reach: Vector | float = 1.0

    @cached_property
    def longest(self) -> Vector:
        """Largest change of each coordinate in one step."""
        return LONGEST_STEP * np.broadcast_to(self.reach, self.lower.shape)


def best(lanes: Sequence[Lane]) -> Lane | None:
    """The lane of lowest cost that has not failed; `None` when all have."""
    sound = [lane for lane in lanes if lane.code != FAILED]
    return min(sound, key=lambda lane: lane.cost) if sound else None
