"""From the starts to the best minimum: parts of windows, whole windows, weights, the solver's error."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import BUDGET, FAILED, FIRST_DAMPING, Course, Lane, Limits, best
from jaxmuscle.estimation.noise import with_estimated_noise
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.refined import refined
from jaxmuscle.estimation.spread import weighted
from jaxmuscle.estimation.stations import Station, in_parts, widened

PARTS = (40, 16, 4)
"""Parts of a window on which starts are brought down first, one after the other.

In a fortieth of a window an error has little time to grow: the cost is nearly that of the accelerations,
which has hardly a minimum but one. Each longer part is begun within reach of its minimum.
"""
SHORTEST_PART = 4
"""Samples in a part at least."""
MOST_LANES = 8
"""Starts under way at a time."""
MOST_NUMBERS = 4e7
"""Derivatives held at a time, which bounds the number of lanes."""
FIRST_SHARE = 0.4
"""Part of the budget after which the search on quarters has to end."""
CAUTIOUS = 1e-3
"""Damping of the first step on whole windows, where the cost may be rugged and its minimum is near."""
SAME = 1e-3
"""Distance of two points in every coordinate up to which they are one."""
ROUNDS = 2
"""Times that the noise is estimated anew."""

Tell = Callable[[str, Course], None]


@dataclasses.dataclass(frozen=True)
class Search:
    """What to search: an objective, starts, limits.

    Attributes:
        estimate: take the noise from the residuals.
        continuation: how many times as wide as it is dry friction is smoothed at first, see `jaxmuscle.fit`.
    """

    objective: Objective
    points: Float[NDArray, "starts k"]
    steps: int
    deadline: float
    estimate: bool
    tell: Tell
    continuation: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class Found:
    """Where a search ended: the objective with its final weights, the best lane, all lanes, iterations."""

    objective: Objective
    best: Lane
    lanes: tuple[Lane, ...]
    points: Float[NDArray, "starts k"]
    limits: Limits
    iterations: int


def search(task: Search) -> Found:
    """Bring all starts down.

    Raises:
        InputError: all starts failed; the reasons are counted.
    """
    objective, counted = task.objective, _Counter(task.tell)
    limits = dataclasses.replace(_limits(task), damping=CAUTIOUS)
    begun = weighted(objective, objective.unknowns.coordinates(objective.unknowns.start))
    now = time.monotonic()
    smooth = dataclasses.replace(limits, damping=FIRST_DAMPING)
    first = dataclasses.replace(smooth, deadline=now + FIRST_SHARE * (task.deadline - now))
    lanes: list[Lane] = []
    for stage, stations in _levels(begun.stations, task.continuation):
        points, failed = _ends(lanes) if lanes else (task.points, {})
        if lanes and (_winner(lanes).code == BUDGET or time.monotonic() > first.deadline):
            break
        parts = dataclasses.replace(objective, stations=stations)
        lanes = _descend_distinct(parts, points, failed, first, counted.on(stage))
    objective = weighted(objective, _winner(lanes).u)
    points, failed = _ends(lanes)
    lanes = _descend_distinct(objective, points, failed, limits, counted.on("whole windows"))
    winner = _winner(lanes)
    sharper = refined(objective, winner.u, limits.lanes) if time.monotonic() < task.deadline else objective
    if sharper is not objective:
        objective, (points, failed) = sharper, _ends(lanes)
        lanes = _descend_distinct(objective, points, failed, limits, counted.on("solver's error taken off"))
        winner = _winner(lanes)
    for _ in range(ROUNDS if task.estimate else 0):
        objective = with_estimated_noise(objective, winner.u, limits.lanes)
        points, failed = _ends(lanes)
        if time.monotonic() > task.deadline:
            winner.code = BUDGET
            break
        lanes = _descend_distinct(objective, points, failed, limits, counted.on("noise estimated"))
        winner = _winner(lanes)
    return Found(objective, winner, tuple(lanes), task.points, limits, counted.total)


def _levels(
    stations: Sequence[Station], continuation: Sequence[float]
) -> Iterator[tuple[str, Sequence[Station]]]:
    """What windows are fitted as before they are whole: in ever longer parts, or with ever drier friction."""
    shortest = min(station.period for station in stations)
    for factor in continuation:
        name = f"friction {factor:g} times as wide"
        yield name, widened(in_parts(stations, PARTS[-1]), factor)
    for many in PARTS[:-1] if not continuation else ():
        if shortest >= SHORTEST_PART * many:
            yield f"windows in {many} parts", in_parts(stations, many)
    yield f"windows in {PARTS[-1]} parts", in_parts(stations, PARTS[-1])


def _ends(lanes: Sequence[Lane]) -> tuple[Float[NDArray, "starts k"], dict[int, Lane]]:
    """Where lanes are, and those that failed, by number."""
    return np.stack([lane.u for lane in lanes]), {i: e for i, e in enumerate(lanes) if e.code == FAILED}


class _Counter:
    """Counts iterations over all stages."""

    def __init__(self, tell: Tell) -> None:
        self.tell, self.total = tell, 0

    def on(self, stage: str) -> Callable[[Course], None]:
        def count(course: Course) -> None:
            self.total += 1
            self.tell(stage, course)

        return count


def _limits(task: Search) -> Limits:
    objective = task.objective
    numbers = max(s.samples for s in objective.stations) * len(objective.unknowns)
    lanes = int(np.clip(MOST_NUMBERS / max(numbers, 1), 1, min(len(task.points), MOST_LANES)))
    lower, upper = objective.unknowns.lower, objective.unknowns.upper
    reach = objective.unknowns.reach
    return Limits(lower, upper, task.steps, lanes, task.deadline, objective.samples, reach)


def _descend_distinct(
    objective: Objective,
    points: Float[NDArray, "starts k"],
    failed: dict[int, Lane],
    limits: Limits,
    tell: Callable[[Course], None],
) -> list[Lane]:
    """Descend from points that differ; those at one place share the outcome, failed ones stay as they are."""
    groups: list[list[int]] = []
    for i, point in enumerate(points):
        if i in failed:
            continue
        twin = next((g for g in groups if np.allclose(points[g[0]], point, rtol=0, atol=SAME)), None)
        groups.append([i]) if twin is None else twin.append(i)
    ends = descend(objective.at, np.stack([points[g[0]] for g in groups]), limits, tell=tell)
    lanes = dict(failed)
    for group, end in zip(groups, ends, strict=True):
        lanes |= dict.fromkeys(group, end)
    return [lanes[i] for i in range(len(points))]


def _winner(lanes: Sequence[Lane]) -> Lane:
    winner = best(lanes)
    if winner is not None:
        return winner
    reasons = [lane.reason for lane in lanes]
    counted = "; ".join(f"{reasons.count(r)} × {r}" for r in dict.fromkeys(reasons))
    many = f"all {len(lanes)} starts failed" if len(lanes) > 1 else "the only start failed"
    raise InputError(
        f"{many}: {counted}. Check the values and units on the card, narrow the priors, or set bounds"
    )
