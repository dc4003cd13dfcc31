"""Score every effect that the rig can have: fitted on some windows, judged on the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.candidates import carries_state
from jaxmuscle.diagnosis.evidence import Evidence, Losses, block_losses, blocks, compare
from jaxmuscle.diagnosis.search import search
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.problem import Problem

STEPS = 60
"""Most steps of a fit on the windows of a fold."""
FEW_WINDOWS = 16
"""Windows below which four folds are made instead of two: half of a short recording determines too little."""
CORES = 2
"""Fits that run side by side."""
BLOCKS = 4
"""Parts into which a window is cut for the test: neighbouring samples are not independent."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect, how well it predicts unseen windows, and the model fitted with it on all windows."""

    effect: type[AbstractEffect]
    evidence: Evidence
    losses: Losses
    model: AbstractActuator


@dataclasses.dataclass(frozen=True)
class Ranking:
    """All candidates, best first, and the loss of the model without any of them."""

    loss: float
    candidates: tuple[Candidate, ...]


def rank(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    progress: Callable[[str], None],
) -> Ranking:
    """Rank the candidates that are not yet accepted.

    The model with each candidate is first fitted to all windows (:func:`search`), which tells its valley.
    The windows, ordered by how much moves in them, go to two folds in turn (four when they are few): from
    there the present model and each candidate are fitted on all folds but one, with all parameters that
    are free anyway, and judged on that one.

    Args:
        model: the present model, fitted to `problem`.
    """
    rest = [effect for effect in bench.candidates if effect.name not in accepted]
    rest.sort(key=carries_state, reverse=True)  # what has to be compiled for itself comes first
    count = fold_count(len(problem.rows))
    folds = Folds(problem, count)
    with ThreadPoolExecutor(CORES) as pool:
        searched = []
        for number, found in enumerate(pool.map(lambda e: search(bench, model, accepted, e, problem), rest)):
            progress(f"tried {rest[number].name} ({number + 1} of {len(rest)})")
            searched.append(found)
        progress("judging all on windows that they were not fitted to")
        models = [(model, list(accepted))]
        models += [(found, [*accepted, e.name]) for e, found in zip(rest, searched, strict=True)]
        tasks = [(*entry, fold) for entry in models for fold in range(count)]
        losses = list(pool.map(lambda task: folds.losses(bench, *task), tasks))
    base, *others = [np.concatenate(losses[i : i + count]) for i in range(0, len(losses), count)]
    candidates = [
        Candidate(effect, compare(base, own), own, found)
        for effect, own, found in zip(rest, others, searched, strict=True)
    ]
    candidates.sort(key=lambda candidate: candidate.evidence.loss)
    return Ranking(float(np.expm1(base.mean())), tuple(candidates))


def fold_count(windows: int) -> int:
    """Number of folds: each is judged by models fitted on the others."""
    return 4 if windows < FEW_WINDOWS else 2


class Folds:
    """The windows of a problem in several parts, each with its share of what moves."""

    def __init__(self, problem: Problem, count: int) -> None:
        self.problem = problem
        self.block = blocks(len(problem.rows), problem.samples, BLOCKS)
        self.fold_of = _folds(problem, count)

    def losses(self, bench: Workbench, model: AbstractActuator, effects: Sequence[str], fold: int) -> Losses:
        """Losses on one fold of `model` fitted, with `effects`, to the others."""
        judged = np.flatnonzero(self.fold_of == fold)
        fitting = self.problem.only(~np.isin(self.block, judged))
        fitted, _ = bench.fit(model, effects, fitting, STEPS)
        residuals = bench.residuals(fitted, self.problem)
        return block_losses(residuals, self.problem.weights, self.block, judged)


def _folds(problem: Problem, count: int) -> NDArray[np.int64]:
    """Fold of each block: whole windows, in turn, in the order of how much their outputs move."""
    extent = np.zeros(len(problem.rows))
    for values in problem.targets.values():
        ranges = np.ptp(np.asarray(values), axis=1).reshape(len(extent), -1).sum(1)
        extent += ranges / max(ranges.max(), 1e-300)
    return np.repeat(np.argsort(np.argsort(-extent)) % count, BLOCKS)
