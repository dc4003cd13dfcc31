"""Search of a tuning: descents from several points; where to begin when the loop runs away at all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.stats import qmc

from jaxmuscle._config import cores
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.free_parameters import settled
from jaxmuscle.optimization.descents import FAILED, Course, Lane, Limits, Tolerances, best
from jaxmuscle.optimization.levenberg_marquardt import descend
from jaxmuscle.optimization.optimistix_solver import bfgs, steps_by
from jaxmuscle.tuning.evaluation import Evaluation

NEAR, NOTICEABLE = 1e-4, 1e-3
"""Relative fall of the cost that is expected at most at a minimum; that eight steps have to bring."""
LEAST_LANES = 2
"""Descents that are under way at a time at least; as many as keep all cores at work, the cheapest first."""
ELSEWHERE, FURTHEST, KEPT = 16, 1e-4, 3
"""Points that are tried where a loop runs away at every start: how many, with gains how many times as large
at least, and from how many of them a descent begins."""


class Search:
    """Descents from several points, stage by stage; what there is to tell about them."""

    def __init__(
        self,
        evaluation: Evaluation,
        steps: int,
        deadline: float,
        solver: object,
        progress: Callable[[str], None],
        begin: float,
    ) -> None:
        self.evaluation, self.progress, self.begin = evaluation, progress, begin
        self.told: list[str] = []
        self.count = 0
        by = None if evaluation.forward else bfgs(NEAR)
        by = by if solver is None else steps_by(solver)
        unknowns = evaluation.unknowns
        tolerances = Tolerances(NEAR, NOTICEABLE, exact=0.0)
        self.limits = Limits(
            unknowns.lower,
            unknowns.upper,
            steps,
            max(LEAST_LANES, -(-cores() // evaluation.programs)),
            deadline,
            2,
            unknowns.reach,
            tolerances,
            best_first=True,
            solver=by,
        )

    def from_points(self, points: Float[np.ndarray, "starts k"], wide: Sequence[float]) -> list[Lane]:
        """The outcome of every start."""
        lanes: list[Lane] = []
        for factor in (*wide, None):
            stage = "whole friction" if wide else "tuning"
            own = self.evaluation
            if factor is not None:
                stage, own = f"friction {factor:g} times as wide", own.widened(factor)
            lanes = self._descend(own, points, stage)
            if best(lanes) is None:
                found = self._elsewhere(own, points)
                if not len(found):
                    return self._unbarred(points, wide)
                lanes, points = self._descend(own, found, stage), found
            points = np.stack([lane.u for lane in lanes if lane.code != FAILED])
        return lanes

    def _unbarred(self, points: NDArray, wide: Sequence[float]) -> list[Lane]:
        """The same where no gains are found with which the linearised loop is stable."""
        self.evaluation = self.evaluation.unbarred()
        self.told.append(
            "No gains were found with which the linearised loop is stable: what they are worth was judged by "
            "their runs alone."
        )
        return self.from_points(points, wide)

    def _descend(self, evaluation: Evaluation, points: NDArray, stage: str) -> list[Lane]:
        def evaluate(trials: Float[np.ndarray, "lanes k"]) -> Any:
            self.count += len(trials)
            return evaluation(trials)

        def tell(course: Course) -> None:
            self.progress(
                f"{stage}, iteration {course.iteration}: cost {course.cost:.6g} ({course.active} under way, "
                f"{course.waiting} waiting, {course.ended} ended; {time.monotonic() - self.begin:.1f} s)"
            )

        lanes = descend(evaluate, points, self.limits, tell=tell)
        failed = [lane.code == FAILED for lane in lanes]
        if any(failed) and not all(failed):
            own = f"The loop is unstable at its start gains: {_runs_away(evaluation, lanes[0].start)}. "
            what = "ran away or was unstable, linearised" if evaluation.stacked.models else "ran away"
            many = f"At {sum(failed)} of {len(lanes)} starts the loop {what}; they were given up."
            self.told.append((own if failed[0] else "") + many)
        return lanes

    def _elsewhere(self, evaluation: Evaluation, points: NDArray) -> NDArray:
        """Points with smaller gains at which the loop does not run away; none where that would be another
        matter without the bar of linearised loops.

        Raises:
            InputError: there is none; it says where the loop runs away at the first start.
        """
        unknowns = evaluation.unknowns
        hypercube = qmc.LatinHypercube(len(unknowns), seed=np.random.default_rng(0))  # pyright: ignore[reportCallIssue]
        shares = hypercube.random(ELSEWHERE)
        first = points[0]
        drawn = np.where(unknowns.logarithmic, first + np.log(FURTHEST) * shares, first * shares)
        drawn = np.clip(drawn, unknowns.lower, unknowns.upper)
        self.count += len(drawn)
        costs = np.array([local.cost if local.finite else np.inf for local in evaluation(drawn)])
        where = _runs_away(evaluation, first)
        if not np.isfinite(costs).any() and evaluation.barred and evaluation.stacked.models:
            return drawn[:0]
        if not np.isfinite(costs).any():
            values = ", ".join(
                f"{n} = {v:g}" for n, v in zip(unknowns.names, unknowns.values(first), strict=True)
            )
            raise InputError(
                f"the loop is unstable at its start gains ({values}): {where}; nor is it stable with smaller "
                f"gains, down to {FURTHEST:g} times as large. Begin elsewhere, or look at signs and units"
            )
        self.told.append(
            f"The loop is unstable at its start gains: {where}. The descent began at smaller ones."
        )
        kept = np.argsort(costs)[:KEPT]
        return drawn[kept[np.isfinite(costs[kept])]]


def _runs_away(evaluation: Evaluation, point: NDArray) -> str:
    """In which scenario, and when, readings at a point are no numbers any more."""
    scenarios = evaluation.stacked
    values = settled(evaluation.unknowns, point)
    unstable = evaluation.unstable(values, evaluation.rows) & evaluation.barred
    if unstable.any():
        return f"linearised, in scenario {scenarios.names[evaluation.rows[int(np.argmax(unstable))]]}"
    seen = evaluation.seen(values, evaluation.rows)
    followed = evaluation.rig.objective.reading
    readings = sorted(seen.readings.items(), key=lambda entry: entry[0] != followed)
    for row in evaluation.rows:
        for name, values in readings:
            wrong = ~np.isfinite(values[row].reshape(scenarios.samples, -1)).all(axis=1)
            if wrong.any():
                at = scenarios.step * int(np.argmax(wrong))
                return f"in scenario {scenarios.names[row]} the {name} is no number from {at:.3g} s on"
    return "its cost, or a derivative of it, is no number"
