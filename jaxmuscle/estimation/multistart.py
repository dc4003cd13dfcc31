"""Multi-start search: duplicates merged, stages of growing windows, the best minimum."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.errors import NoFitError
from jaxmuscle.estimation.dataset import Station, in_parts, widened
from jaxmuscle.estimation.deferred_correction import refined
from jaxmuscle.estimation.initial_states import loosened
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.predicted_inputs import (
    command_errors,
    predicts_better,
    with_inputs_of,
    with_predicted_inputs,
)
from jaxmuscle.estimation.weights import weighted
from jaxmuscle.optimization.descents import BUDGET, FAILED, Course, Lane, Limits, Local, best
from jaxmuscle.optimization.levenberg_marquardt import descend

PARTS = (40, 16, 4)
"""Parts of a window on which starts are brought down first, one after the other.

In a fortieth of a window an error has little time to grow: the cost is nearly that of the accelerations,
which has hardly a minimum but one. Each longer part is begun within reach of its minimum.
"""
SHORTEST_PART = 4
"""Samples in a part at least."""


def stages(
    stations: Sequence[Station], continuation: Sequence[float]
) -> Iterator[tuple[str, Sequence[Station]]]:
    """Name and windows of each stage: in ever longer parts, or with ever drier friction."""
    shortest = min(station.period for station in stations)
    for factor in continuation:
        name = f"friction {factor:g} times as wide"
        yield name, widened(in_parts(stations, PARTS[-1]), factor)
    for many in PARTS[:-1] if not continuation else ():
        if shortest >= SHORTEST_PART * many:
            yield f"windows in {many} parts", in_parts(stations, many)
    yield f"windows in {PARTS[-1]} parts", in_parts(stations, PARTS[-1])


SAME = 1e-3
"""Distance of two points in every coordinate up to which they are one."""


def ends(lanes: Sequence[Lane]) -> tuple[Float[np.ndarray, "starts k"], dict[int, Lane]]:
    """Where lanes are, and those that failed, by number."""
    return np.stack([lane.u for lane in lanes]), {i: e for i, e in enumerate(lanes) if e.code == FAILED}


def descend_distinct(
    objective: Objective,
    points: Float[np.ndarray, "starts k"],
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
    found = descend(objective.at, np.stack([points[g[0]] for g in groups]), limits, tell=tell)
    lanes = dict(failed)
    for group, end in zip(groups, found, strict=True):
        lanes |= dict.fromkeys(group, end)
    return [lanes[i] for i in range(len(points))]


def winner_of(lanes: Sequence[Lane]) -> Lane:
    """The best lane.

    Raises:
        NoFitError: all failed; the reasons are counted.
    """
    winner = best(lanes)
    if winner is not None:
        return winner
    reasons = [lane.reason for lane in lanes]
    counted = "; ".join(f"{reasons.count(r)} × {r}" for r in dict.fromkeys(reasons))
    many = f"all {len(lanes)} starts failed" if len(lanes) > 1 else "the only start failed"
    raise NoFitError(
        f"{many}: {counted}. Check the values and units on the card, narrow the priors, or set bounds"
    )


MOST_LANES = 32
"""Starts under way at a time: the others wait, so that some have ended when the time is up."""
WIDTH = 4
"""Starts in one program: with more, what a step touches no longer fits into a core's cache."""
MOST_NUMBERS = 4e7
"""Derivatives in one program at most, which bounds its starts."""
FIRST_SHARE = 0.4
"""Part of the budget after which the search on quarters has to end."""
INPUTS = 2
"""Times that inputs of links are predicted: by what was fitted with them as measured, then by that fit."""
ROUNDS = 8
"""Times at most that the weights are taken anew from the residuals."""

Tell = Callable[[str, Course], None]


@dataclasses.dataclass(frozen=True)
class Search:
    """What to search: an objective, starts, limits.

    Attributes:
        reweigh: the objective, weighted by the sensors' noise, with weights from its residuals at a point;
            `None` to keep them.
        continuation: how many times as wide as it is dry friction is smoothed at first, see `jaxmuscle.fit`.
        solver: in place of our own, see `lane.Limits`.
    """

    objective: Objective
    points: Float[np.ndarray, "starts k"]
    steps: int
    deadline: float
    reweigh: Callable[[Objective, Float[np.ndarray, " k"]], Objective] | None
    tell: Tell
    continuation: tuple[float, ...] = ()
    solver: Callable[[Lane, Local, Limits], None] | None = None

    def reweighed(self, objective: Objective, u: Float[np.ndarray, " k"]) -> Objective:
        """An objective weighted by the sensors' noise, with the weights that are asked for, at u."""
        return objective if self.reweigh is None else self.reweigh(objective, u)


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
        NoFitError: all starts failed; the reasons are counted.
    """
    objective, counted = side_by_side(task.objective, len(task.points)), _Counter(task.tell)
    limits = _limits(task)
    begun = weighted(objective, objective.unknowns.coordinates(objective.unknowns.start))
    now = time.monotonic()
    first = dataclasses.replace(limits, deadline=now + FIRST_SHARE * (task.deadline - now))
    lanes: list[Lane] = []
    for stage, stations in stages(begun.stations, task.continuation):
        points, failed = ends(lanes) if lanes else (task.points, {})
        if lanes and (winner_of(lanes).code == BUDGET or time.monotonic() > first.deadline):
            break
        parts = dataclasses.replace(objective, stations=stations)
        parts = task.reweighed(parts, winner_of(lanes).u if lanes else task.points[0])
        lanes = descend_distinct(parts, points, failed, first, counted.on(stage))
    measured = objective
    by_sensors = loosened(weighted(measured, winner_of(lanes).u), winner_of(lanes).u)
    objective, lanes = _on_whole_windows(task, by_sensors, lanes, limits, counted.on("whole windows"))
    own = _with_inputs_predicted(task, measured, lanes, limits, counted.on("inputs as predicted"))
    if own is not None and predicts_better(*(_command_errors(measured, each) for each in (own[2], lanes))):
        by_sensors, objective, lanes = own
    winner = winner_of(lanes)
    sharper = _sharper(by_sensors, winner, task)
    if sharper is not by_sensors:
        by_sensors, (points, failed) = sharper, ends(lanes)
        objective = task.reweighed(by_sensors, winner.u)
        lanes = descend_distinct(objective, points, failed, limits, counted.on("solver's error taken off"))
        winner = winner_of(lanes)
    if task.reweigh is not None:
        objective, lanes = _with_own_weights(task, by_sensors, lanes, limits, counted)
    return Found(objective, winner_of(lanes), tuple(lanes), task.points, limits, counted.total)


def _with_inputs_predicted(
    task: Search,
    measured: Objective,
    lanes: Sequence[Lane],
    limits: Limits,
    tell: Callable[[Course], None],
) -> tuple[Objective, Objective, list[Lane]] | None:
    """The objective with inputs of links as predicted, that with the weights asked for, and its minima.

    `None` where nothing is predicted: no link has such an input, the model is wrong about it, or there is no
    time left.
    """
    found = None
    for _ in range(INPUTS):
        winner = winner_of(lanes)
        inputs = predicted_at(measured, winner.u)
        if inputs is measured or time.monotonic() > task.deadline:
            break
        by_sensors, (points, failed) = loosened(weighted(inputs, winner.u), winner.u), ends(lanes)
        objective = task.reweighed(by_sensors, winner.u)
        lanes = descend_distinct(objective, points, failed, limits, tell)
        found = by_sensors, objective, lanes
    return found


def predicted_at(objective: Objective, u: Float[np.ndarray, " k"]) -> Objective:
    """The objective with inputs of links as predicted at u; itself where none is."""
    stations = []
    for number, station in enumerate(objective.stations):
        machine, moved = objective.moved(number, u)
        whole = dataclasses.replace(station.problem, begin=moved.begin)
        inputs = with_inputs_of(station.problem, with_predicted_inputs(machine, whole))
        stations.append(dataclasses.replace(station, problem=inputs))
    same = all(a.problem is b.problem for a, b in zip(stations, objective.stations, strict=True))
    return objective if same else dataclasses.replace(objective, stations=stations)


def _command_errors(objective: Objective, lanes: Sequence[Lane]) -> Float[np.ndarray, " windows"]:
    """Errors of predictions from the command alone, at the best of several minima; of all recordings."""
    u, numbers = winner_of(lanes).u, range(len(objective.stations))
    return np.concatenate([command_errors(*objective.moved(number, u)) for number in numbers])


def _with_own_weights(
    task: Search, by_sensors: Objective, lanes: list[Lane], limits: Limits, counted: _Counter
) -> tuple[Objective, list[Lane]]:
    """The objective with weights from the residuals that it leaves, and where it has its minimum."""
    objective = by_sensors
    for _ in range(ROUNDS):
        winner, (points, failed) = winner_of(lanes), ends(lanes)
        objective = task.reweighed(by_sensors, winner.u)
        lanes = descend_distinct(objective, points, failed, limits, counted.on("weights from residuals"))
        same = np.allclose(winner_of(lanes).u, winner.u, rtol=0, atol=SAME)
        if same or time.monotonic() > task.deadline:
            break
    return objective, lanes


def _on_whole_windows(
    task: Search,
    by_sensors: Objective,
    lanes: Sequence[Lane],
    limits: Limits,
    tell: Callable[[Course], None],
) -> tuple[Objective, list[Lane]]:
    """Descend from where the parts of windows led, and from the first start if the cost is less there.

    The first start is the machine as it was given. It may come from a fit: where the cost has several
    valleys (joints that stick), parts of windows may lead out of the best one. With weights from residuals
    both are looked at by those of the first start: what is less by the weights of a point is less by its own.
    """
    (points, failed), begin = ends(lanes), task.points[0]
    objective = task.reweighed(by_sensors, begin)
    if 0 not in failed:
        there, here = objective.at(np.stack([points[0], begin]))
        if here.finite and here.cost < there.cost:
            *found, own = descend_distinct(objective, np.vstack([points, begin]), failed, limits, tell)
            found[0] = winner_of([found[0], own])
            return objective, found
    objective = task.reweighed(by_sensors, winner_of(lanes).u)
    return objective, descend_distinct(objective, points, failed, limits, tell)


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
