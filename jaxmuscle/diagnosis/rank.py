"""Score every effect that the rig can have: fitted on some windows, judged on the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.candidates import linear_strength, starts, strength_path
from jaxmuscle.diagnosis.evidence import Blocks, Evidence, Losses, block_losses, blocks, compare
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.fit import Minimum
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.parameters import parameters, replace

FIRST_STEPS, LAST_STEPS = 12, 60
"""Steps of every candidate's fit, and of those of the best few."""
FINALISTS = 3
WITHIN_REACH = 5.0
"""Ratio of losses after the first try up to which a candidate may still overtake the best one."""
FEW_WINDOWS = 16
"""Windows below which four folds are made instead of two: half of a short recording determines too little."""


def fold_count(windows: int) -> int:
    """Number of folds: each is judged by models fitted on the others."""
    return 4 if windows < FEW_WINDOWS else 2


CORES = 2
"""Fits that run side by side."""
BLOCKS = 4
"""Parts into which a window is cut for the test: neighbouring samples are not independent."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect, how well it predicts unseen windows, and the model fitted with it on each fold."""

    effect: type[AbstractEffect]
    evidence: Evidence
    losses: Losses
    models: tuple[AbstractActuator, ...]


@dataclasses.dataclass(frozen=True)
class Ranking:
    """All candidates, best first, and the loss of the model without any of them."""

    base: Losses
    loss: float
    candidates: tuple[Candidate, ...]


@dataclasses.dataclass(frozen=True)
class _Trial:
    model: AbstractActuator
    losses: Losses


def rank(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    progress: Callable[[str], None],
) -> Ranking:
    """Rank the candidates that are not yet accepted.

    The windows, ordered by how much moves in them, go to two folds in turn (four when they are few). The
    present model and the model with each candidate are fitted on all folds but one, with all parameters that
    are free anyway, and judged on that one.
    """
    rest = [effect for effect in bench.candidates if effect.name not in accepted]
    count = fold_count(len(problem.rows))
    block, fold_of = blocks(len(problem.rows), problem.samples, BLOCKS), _folds(problem, count)

    def on(fold: int) -> _Fold:
        return _Fold(bench, tuple(accepted), problem, block, np.flatnonzero(fold_of == fold), model)

    with ThreadPoolExecutor(CORES) as pool:
        folds = list(pool.map(on, range(count)))
        base = np.concatenate([fold.losses(fold.base) for fold in folds])

        def judged(effect: type[AbstractEffect], trials: list[_Trial]) -> Candidate:
            losses = np.concatenate([trial.losses for trial in trials])
            return Candidate(effect, compare(base, losses), losses, tuple(t.model for t in trials))

        estimates = list(pool.map(lambda fold: fold.estimates(rest), folds))
        candidates = []
        for number, effect in enumerate(rest):
            progress(f"trying {effect.name} ({number + 1} of {len(rest)})")
            tried = pool.map(lambda i, e=effect: folds[i].first_try(e, estimates[i][e.name]), range(count))
            candidates.append(judged(effect, list(tried)))
        candidates.sort(key=lambda c: c.evidence.loss)
        reach = WITHIN_REACH * candidates[0].evidence.loss
        for place, candidate in enumerate(c for c in candidates[:FINALISTS] if c.evidence.loss <= reach):
            progress(f"fitting {candidate.effect.name} to the end")
            fitted = pool.map(
                lambda i, c=candidate: folds[i].fit(c.effect, c.models[i], LAST_STEPS), range(count)
            )
            candidates[place] = judged(candidate.effect, list(fitted))
    candidates.sort(key=lambda c: c.evidence.loss)
    return Ranking(base, float(np.expm1(base.mean())), tuple(candidates))


def _folds(problem: Problem, count: int) -> NDArray[np.int64]:
    """Fold of each block: whole windows, in turn, in the order of how much their outputs move."""
    extent = np.zeros(len(problem.rows))
    for values in problem.targets.values():
        ranges = np.ptp(np.asarray(values), axis=1).reshape(len(extent), -1).sum(1)
        extent += ranges / max(ranges.max(), 1e-300)
    return np.repeat(np.argsort(np.argsort(-extent)) % count, BLOCKS)


class _Fold:
    """Some blocks to be judged on, all others to be fitted on."""

    def __init__(
        self,
        bench: Workbench,
        accepted: tuple[str, ...],
        problem: Problem,
        block: Blocks,
        judged: NDArray[np.int64],
        model: AbstractActuator,
    ) -> None:
        self.bench, self.accepted, self.problem = bench, accepted, problem
        self.block, self.judged = block, judged
        self.fitting = problem.only(~np.isin(block, judged))
        self.base, _ = bench.fit(model, accepted, self.fitting, LAST_STEPS)

    def losses(self, model: AbstractActuator) -> Losses:
        residuals = self.bench.residuals(model, self.problem)
        return block_losses(residuals, self.problem.weights, self.block, self.judged)

    def estimates(self, effects: Sequence[type[AbstractEffect]]) -> dict[str, float]:
        """Strength of each effect by one linear step from the card's values, the others moving along."""
        own = self.bench.free_paths(self.base, self.accepted)
        card = self.bench.with_card_values(self.base)
        best: dict[str, tuple[float, float]] = {}
        for shape in range(max(len(effect.starts) for effect in effects)):
            shaped = [effect for effect in effects if shape < len(effect.starts)]
            model = replace(card, {k: v for e in shaped for k, v in _shape(e, shape).items()})
            paths = [*own, *(strength_path(effect) for effect in shaped)]
            residual, slopes = self.bench.jacobian(model, self.fitting, paths, self.accepted)
            for effect, slope in zip(shaped, slopes[len(own) :], strict=True):
                strength, gain = linear_strength(residual, slopes[: len(own)], slope)
                if gain >= best.get(effect.name, (0.0, -1.0))[1]:
                    best[effect.name] = (strength, gain)
        return {name: strength for name, (strength, _) in best.items()}

    def first_try(self, effect: type[AbstractEffect], estimate: float) -> _Trial:
        """The better of two short fits: from the fitted model, and from the values of the card.

        The fitted model may be bent far to make up for what is missing, and then lies in a valley of its own.
        """
        entry = parameters(self.base)[strength_path(effect)]
        fits = []
        for base in (self.base, self.bench.with_card_values(self.base)):
            tries = [replace(base, start) for start in starts(effect, estimate, entry.nonnegative)]
            costs = [self.bench.cost(trial, self.fitting) for trial in tries]
            fits.append(self._fitted(effect, tries[int(np.argmin(costs))], FIRST_STEPS))
        model, _ = min(fits, key=lambda fit: fit[1].cost)
        return _Trial(model, self.losses(model))

    def fit(self, effect: type[AbstractEffect], model: AbstractActuator, steps: int) -> _Trial:
        fitted, _ = self._fitted(effect, model, steps)
        return _Trial(fitted, self.losses(fitted))

    def _fitted(
        self, effect: type[AbstractEffect], model: AbstractActuator, steps: int
    ) -> tuple[AbstractActuator, Minimum]:
        return self.bench.fit(model, [*self.accepted, effect.name], self.fitting, steps)


def _shape(effect: type[AbstractEffect], number: int) -> dict[str, float]:
    """Values of an effect's parameters other than its strength, for one of its starts."""
    shape = effect.starts[number]
    if effect.strength in shape:
        return {}
    return {f"effects.{effect.name}.{name}": value for name, value in shape.items()}
