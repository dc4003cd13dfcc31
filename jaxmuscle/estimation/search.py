"""From the starts to the best minimum: parts of windows, whole windows, weights, the solver's error."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.estimation.distinct import descend_distinct, ends, winner_of
from jaxmuscle.estimation.lane import BUDGET, Course, Lane, Limits, Local
from jaxmuscle.estimation.loosened import loosened
from jaxmuscle.estimation.noise import with_estimated_noise
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.refined import refined
from jaxmuscle.estimation.spread import weighted
from jaxmuscle.estimation.stages import stages
from jaxmuscle.estimation.stations import Station

MOST_LANES = 32
"""Starts under way at a time: the others wait, so that some have ended when the time is up."""
WIDTH = 4
"""Starts in one program: with more, what a step touches no longer fits into a core's cache."""
MOST_NUMBERS = 4e7
"""Derivatives in one program at most, which bounds its starts."""
FIRST_SHARE = 0.4
"""Part of the budget after which the search on quarters has to end."""
ROUNDS = 2
"""Times that the noise is estimated anew."""

Tell = Callable[[str, Course], None]


@dataclasses.dataclass(frozen=True)
class Search:
    """What to search: an objective, starts, limits.

    Attributes:
        estimate: take the noise from the residuals.
        continuation: how many times as wide as it is dry friction is smoothed at first, see `jaxmuscle.fit`.
        solver: in place of our own, see `lane.Limits`.
        near: whether the starts are near a minimum, and come down on whole windows at once.
    """

    objective: Objective
    points: Float[np.ndarray, "starts k"]
    steps: int
    deadline: float
    estimate: bool
    tell: Tell
    continuation: tuple[float, ...] = ()
    solver: Callable[[Lane, Local, Limits], None] | None = None
    near: bool = False


@dataclasses.dataclass(frozen=True)
class Found:
    """Where a search ended: the objective with its final weights, the best lane, all lanes, iterations."""

    objective: Objective
    best: Lane
    lanes: tuple[Lane, ...]
    points: Float[np.ndarray, "starts k"]
    limits: Limits
    iterations: int


def search(task: Search) -> Found:
    """Bring all starts down.

    Raises:
        InputError: all starts failed; the reasons are counted.
    """
    objective, counted = side_by_side(task.objective, len(task.points)), _Counter(task.tell)
    limits = _limits(task)
    begun = weighted(objective, objective.unknowns.coordinates(objective.unknowns.start))
    now = time.monotonic()
    first = dataclasses.replace(limits, deadline=now + FIRST_SHARE * (task.deadline - now))
    lanes: list[Lane] = []
    for stage, stations in _stages(task, begun):
        points, failed = ends(lanes) if lanes else (task.points, {})
        if lanes and (winner_of(lanes).code == BUDGET or time.monotonic() > first.deadline):
            break
        parts = dataclasses.replace(objective, stations=stations)
        lanes = descend_distinct(parts, points, failed, first, counted.on(stage))
    objective = loosened(weighted(objective, winner_of(lanes).u), winner_of(lanes).u)
    points, failed = ends(lanes)
    lanes = descend_distinct(objective, points, failed, limits, counted.on("whole windows"))
    winner = winner_of(lanes)
    sharper = _sharper(objective, winner, task)
    if sharper is not objective:
        objective, (points, failed) = sharper, ends(lanes)
        lanes = descend_distinct(objective, points, failed, limits, counted.on("solver's error taken off"))
        winner = winner_of(lanes)
    for _ in range(ROUNDS if task.estimate else 0):
        objective = with_estimated_noise(objective, winner.u)
        points, failed = ends(lanes)
        if time.monotonic() > task.deadline:
            winner.code = BUDGET
            break
        lanes = descend_distinct(objective, points, failed, limits, counted.on("noise estimated"))
        winner = winner_of(lanes)
    return Found(objective, winner, tuple(lanes), task.points, limits, counted.total)


def _stages(task: Search, begun: Objective) -> Iterable[tuple[str, Sequence[Station]]]:
    if task.near:
        return [("whole windows, first weights", begun.stations)]
    return stages(begun.stations, task.continuation)


def _sharper(objective: Objective, winner: Lane, task: Search) -> Objective:
    """The objective with the solver's error taken off, if there is time left."""
    if winner.local is None or time.monotonic() >= task.deadline:
        return objective
    return refined(objective, winner.u, winner.local.matrix)


class _Counter:
    """Counts iterations over all stages."""

    def __init__(self, tell: Tell) -> None:
        self.tell, self.total = tell, 0

    def on(self, stage: str) -> Callable[[Course], None]:
        def count(course: Course) -> None:
            self.total += 1
            self.tell(stage, course)

        return count


def side_by_side(objective: Objective, points: int) -> Objective:
    """The objective with as many points in one program as are best."""
    numbers = max(s.samples for s in objective.stations) * len(objective.unknowns)
    width = int(np.clip(MOST_NUMBERS / max(numbers, 1), 1, min(points, WIDTH)))
    return dataclasses.replace(objective, width=width)


def _limits(task: Search) -> Limits:
    objective = task.objective
    lanes = min(len(task.points), MOST_LANES)
    lower, upper = objective.unknowns.lower, objective.unknowns.upper
    reach = objective.unknowns.reach
    return Limits(
        lower, upper, task.steps, lanes, task.deadline, objective.samples, reach, solver=task.solver
    )
