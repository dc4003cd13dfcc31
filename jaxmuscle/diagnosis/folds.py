"""Folds of a recording: blocks that a model is judged on, by turns, after it was fitted to the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.evidence import SAFE, Blocks, Losses, block_losses
from jaxmuscle.diagnosis.head_start import head_start
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.workbench import SLOW, Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parameters import get

FOLDS = 4
"""Folds of a round. With two, a fit to half of the recording determines too little: gravity on practice
recording 11 then removes 0.22 of the excess with p = 0.048, with four 0.33 with p = 0.008."""


STEPS = 60
"""Most steps of a fit on the windows of a fold."""


class Folds:
    """The blocks of a problem, stretches predicted in one go, in several folds.

    Where residuals are independent from block to block, blocks go to the folds in turn, ordered by how much
    moves in them. Where they go together over several, folds are contiguous in time, and what lies within
    a correlation time of a judged one is not fitted: a model could learn there what the noise goes on to do.

    Attributes:
        count: number of folds.
        stretch: blocks in time that are flipped together, :func:`correlated_blocks`.
        fold_of: fold of each block.
    """

    def __init__(self, problem: Problem, block: Blocks, stretch: int) -> None:
        self.problem, self.block, self.stretch = problem, block, stretch
        number = int(block.max()) + 1
        self.count = FOLDS
        if stretch > 1:
            self.fold_of = np.arange(number) * self.count // number
        else:
            order = np.argsort(-_extent(problem, block), kind="stable")
            self.fold_of = np.empty(number, dtype=int)
            self.fold_of[order] = np.arange(number) % self.count

    def judged(
        self, bench: Workbench, fitted: SettledFit, effects: Sequence[str], fold: int
    ) -> tuple[Losses, AbstractActuator]:
        """A model fitted, with `effects`, to all folds but one, and its losses on that one, without the head
        start that a clock offset is (:mod:`~jaxmuscle.diagnosis.head_start`).

        Args:
            fitted: the model fitted to everything, where the fit begins, and its weights.
        """
        judged = np.flatnonzero(self.fold_of == fold)
        fitting = self.problem.only(~np.isin(self.block, self._beside(judged)))

        def fit() -> SettledFit:
            model, lane = bench.fit(fitted.model, effects, fitting, STEPS, SLOW, fitted.factors)
            return SettledFit(model, lane.cost, lane.code, fitted.left, fitted.far)

        model = bench.kept("fold", fitted.model, effects, (fitting, fitted.factors), fit).model
        residuals = bench.residuals(model, self.problem)
        losses = block_losses(residuals, self.problem.weights, self.block, judged)
        return losses + head_start(bench, model, self.problem, self.block, judged), model

    def _beside(self, judged: NDArray[np.int64]) -> NDArray[np.int64]:
        """The judged blocks and those near them that are not fitted either."""
        gap = self.stretch // SAFE if self.stretch > 1 else 0
        near = judged[:, None] + np.arange(-gap, gap + 1)
        return np.unique(near)

    def in_time(self, losses: Sequence[Losses]) -> Losses:
        """Losses fold by fold, put into the order of time."""
        order = np.concatenate([np.flatnonzero(self.fold_of == fold) for fold in range(self.count)])
        return np.concatenate(losses, axis=1)[:, np.argsort(order)]


def disagreement(models: Sequence[AbstractActuator], path: str) -> float:
    """Standard deviation of a parameter by how much fits to the folds disagree; 0 of fewer than two.

    The delete-a-group jackknife over models of the same effects, each fitted without a part of the data
    (Kott, J. Official Statistics 17, 2001), allows for what the model lacks, as no covariance does.
    """
    if len(models) < 2:
        return 0.0
    values = np.array([float(get(model, path)) for model in models])
    return float(np.sqrt((len(models) - 1) * values.var()))


def _extent(problem: Problem, block: Blocks) -> NDArray[np.float64]:
    """How much the outputs move in each block, the most in any being 1 for each output."""
    parts = range(int(block.max()) + 1)
    rows = [np.nonzero(block == part) for part in parts]
    extent = np.zeros(len(rows))
    for output, values in problem.targets.items():
        table, there = np.asarray(values), np.asarray(problem.weights[output]) > 0
        ranges = np.array([_ranges(table[r], there[r]) for r in rows])
        extent += ranges / max(ranges.max(), 1e-300)
    return extent


def _ranges(values: NDArray[np.float64], there: NDArray[np.bool_]) -> float:
    """Sum over muscles of the range of the samples that count."""
    table, mask = values.reshape(len(values), -1), there.reshape(len(there), -1)
    return float(sum(np.ptp(v[m]) if m.any() else 0.0 for v, m in zip(table.T, mask.T, strict=True)))
