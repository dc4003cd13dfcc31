"""Score every effect that the rig can have: fitted on some windows, judged on the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.cores import cores
from jaxmuscle.diagnosis.candidates import carries_state
from jaxmuscle.diagnosis.evidence import Blocks, Evidence, Losses, block_losses, blocks, compare
from jaxmuscle.diagnosis.search import search
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.diagnosis.workload import JUDGEMENT, round_work
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.progress import Meter

Task = TypeVar("Task")
Result = TypeVar("Result")

STEPS = 60
"""Most steps of a fit on the windows of a fold."""
FEW = 64
"""Blocks below which four folds are made instead of two: half of a short recording determines too little."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect, how well it predicts unseen windows, and the models fitted with it.

    `model`: to all blocks; `folds`: to all but those of one fold, fold by fold.
    """

    effect: type[AbstractEffect]
    evidence: Evidence
    losses: Losses
    model: AbstractActuator
    folds: tuple[AbstractActuator, ...]


@dataclasses.dataclass(frozen=True)
class Ranking:
    """All candidates, best first; the loss of the model without any of them, and its fits to each fold."""

    loss: float
    folds: tuple[AbstractActuator, ...]
    candidates: tuple[Candidate, ...]


def rank(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    meter: Meter,
) -> Ranking:
    """Rank the candidates that are not yet accepted.

    The model with each candidate is first fitted to everything (:func:`search`), which tells its valley. The
    blocks, stretches predicted in one go, ordered by how much moves in them, go to two folds in turn (four
    when they are few): from there the present model and each candidate are fitted on all folds but one, with
    all parameters that are free anyway, and judged on that one.
    """
    rest = [effect for effect in bench.candidates if effect.name not in accepted]
    rest.sort(key=carries_state, reverse=True)  # what has to be compiled for itself comes first
    folds = Folds(problem)
    if accepted:
        meter.expect(round_work(rest, folds.count, again=True))
    searched = _on_all_cores(lambda effect: search(bench, model, accepted, effect, problem, meter), rest)
    models = [(model, list(accepted))]
    models += [(found, [*accepted, e.name]) for e, found in zip(rest, searched, strict=True)]
    tasks = [(*entry, fold) for entry in models for fold in range(folds.count)]

    def judge(task: tuple[AbstractActuator, list[str], int]) -> tuple[Losses, AbstractActuator]:
        judged = folds.judged(bench, *task)
        meter.did(JUDGEMENT, "judging all on windows that they were not fitted to")
        return judged

    judged, count = _on_all_cores(judge, tasks), folds.count
    losses = [
        np.concatenate([loss for loss, _ in judged[i : i + count]]) for i in range(0, len(judged), count)
    ]
    fitted = [tuple(model for _, model in judged[i : i + count]) for i in range(0, len(judged), count)]
    base = losses[0]
    candidates = [
        Candidate(effect, compare(base, own), own, found, models)
        for effect, own, found, models in zip(rest, losses[1:], searched, fitted[1:], strict=True)
    ]
    candidates.sort(key=lambda candidate: candidate.evidence.loss)
    return Ranking(float(np.expm1(base.mean())), fitted[0], tuple(candidates))


def _on_all_cores(function: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
    """`function` of every task, as many side by side as there are cores.

    After an error or a Ctrl-C, tasks that have not begun are dropped, and the others are not waited for.
    """
    pool = ThreadPoolExecutor(cores(), thread_name_prefix="diagnosis")
    try:
        return list(pool.map(function, tasks))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def fold_count(problem: Problem) -> int:
    """Number of folds into which the blocks of a problem go."""
    number = int(blocks(len(problem.rows), problem.samples, int(problem.period)).max()) + 1
    return 4 if number < FEW else 2


class Folds:
    """The blocks of a problem in several parts, each with its share of what moves."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.block = blocks(len(problem.rows), problem.samples, int(problem.period))
        number = int(self.block.max()) + 1
        self.count = fold_count(problem)
        order = np.argsort(-_extent(problem, self.block), kind="stable")
        self.fold_of = np.empty(number, dtype=int)
        self.fold_of[order] = np.arange(number) % self.count

    def judged(
        self, bench: Workbench, model: AbstractActuator, effects: Sequence[str], fold: int
    ) -> tuple[Losses, AbstractActuator]:
        """`model` fitted, with `effects`, to all folds but one, and its losses on that one."""
        judged = np.flatnonzero(self.fold_of == fold)
        fitting = self.problem.only(~np.isin(self.block, judged))
        fitted, _ = bench.fit(model, effects, fitting, STEPS)
        residuals = bench.residuals(fitted, self.problem)
        return block_losses(residuals, self.problem.weights, self.block, judged), fitted


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
