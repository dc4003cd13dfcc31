"""Ranking of candidate effects by cross-validation: fitted on some windows, judged on the others.

Work is counted in seconds of the sample `lift` on two cores, from nothing compiled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import (
    SETTLED,
    Workbench,
    carries_state,
    linear_strength,
    paths_of,
    shapes,
    strength_path,
    strengths,
)
from jaxmuscle.diagnosis.evidence import (
    LIKELIHOOD_RATIO,
    SAFE,
    Blocks,
    Evidence,
    Losses,
    block_losses,
    block_means,
    blocks,
    compare,
    correlated_blocks,
    gain,
)
from jaxmuscle.diagnosis.likelihood_ratio import likelihood_ratio_test
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.progress import Meter

DECLARED = 13.0
"""First fit of the declared model, and all that a search runs compiled beside it; two more fits."""
CONCLUSION = 8.0
"""Last fit, held-out predictions, what is unexplained: half of it is compilation."""
SEARCH, SEARCH_WITH_STATE = 0.2, 0.8
"""Search of one candidate, and of one with a state of its own."""
SEARCH_STEPS = (0.2, 0.3, 0.2, 0.3)
"""Parts of a search: first start, short fit from it, second start, fits to the end."""
JUDGEMENT = 0.07
"""A fit to one fold, and its judgement."""
REFIT = 0.1


def search_work(effect: type[AbstractEffect]) -> float:
    """Work of the search of one candidate."""
    return SEARCH_WITH_STATE if carries_state(effect) else SEARCH


def round_work(effects: Sequence[type[AbstractEffect]], folds: int) -> float:
    """Work of a round that tries `effects` and judges them, and the model without them, on `folds` folds."""
    searched = sum(search_work(effect) for effect in effects)
    return searched + JUDGEMENT * folds * (len(effects) + 1)


SHORT_STEPS, LONG_STEPS = 12, 60
"""Steps of the fit from each base, and of the better one of them to its end."""
SLOW = 1e-3
"""Fall of the cost over eight steps, relative to it, below which a candidate's search, and the fit of any
model to a fold, is at its end.

With the fits to all windows of the model without candidates ended like that, too, practice recording 14 has
effects found that are not there: what searches begin with must be as good as it can be.
"""


def search(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: type[AbstractEffect],
    problem: Problem,
    meter: Meter,
) -> AbstractActuator:
    """`model` with `effect` added and everything fitted to `problem`.

    Two short fits are made, from the fitted model and from the values of the card, and the better one is
    carried on: the fitted model may be bent far to make up for what is missing, and then lies in a valley
    of its own. Each begins where the cost is least among several strengths of several shapes.
    """
    names = [*accepted, effect.name]
    work, parts, fits = search_work(effect), iter(SEARCH_STEPS), []
    for base in (model, bench.with_card_values(model)):
        begin = _best_start(bench, bench.dressed(base, names), accepted, effect, problem)
        meter.did(next(parts) * work, f"trying {effect.name}")
        fits.append(bench.fit(begin, names, problem, SHORT_STEPS, SLOW))
        meter.did(next(parts) * work, f"trying {effect.name}")
    best, minimum = min(fits, key=lambda fit: fit[1].cost)
    return best if minimum.code in SETTLED else bench.fit(best, names, problem, LONG_STEPS, SLOW)[0]


def _best_start(
    bench: Workbench,
    base: AbstractActuator,
    accepted: Sequence[str],
    effect: type[AbstractEffect],
    problem: Problem,
) -> AbstractActuator:
    """`base` with the strength and shape of `effect` at which the cost is least."""
    path = strength_path(effect)
    tries = []
    for shape in shapes(effect):
        shaped = replace(base, shape)
        if path in shape:
            tries.append(shaped)
        else:
            found = _strengths(bench, shaped, accepted, effect, problem)
            tries += [replace(shaped, {path: strength}) for strength in found]
    return min(tries, key=lambda trial: bench.cost(trial, problem), default=base)


def _strengths(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: type[AbstractEffect],
    problem: Problem,
) -> list[float]:
    """Strengths over the whole range, and the one of a linear step with which the free parameters move."""
    path = strength_path(effect)
    own = bench.free_paths(model, accepted)
    residual, slopes = bench.jacobian(model, problem, [*own, path], [*accepted, effect.name])
    nonnegative = parameters(model)[path].nonnegative
    linear, _ = linear_strength(residual, slopes[: len(own)], slopes[len(own)])
    return [abs(linear) if nonnegative else linear, *strengths(slopes[len(own)], residual, nonnegative)]


STEPS = 60
"""Most steps of a fit on the windows of a fold."""
PROMISING = 0.05
"""Part of the excess error that a candidate has to remove on the windows that it is fitted to, to be judged
on others."""
FAR, FIRST = 2.0, 3
"""A candidate that leaves so many times as much excess error as the best one, where it is fitted, is not
judged on other windows either, unless it is among the first so many."""
MOST = 5
"""Candidates that are judged on other windows at most: those that explain most where they are fitted."""
FOLDS = 4
"""Folds of a round. With two, a fit to half of the recording determines too little: gravity on practice
recording 11 then removes 0.22 of the excess with p = 0.048, with four 0.33 with p = 0.008."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect, how well it predicts unseen windows, and the models fitted with it.

    `model`: to all blocks; `folds`: to all but those of one fold, fold by fold. Without folds it was not
    tried on unseen windows: its evidence is that of the windows it was fitted to, and too little.
    """

    effect: type[AbstractEffect]
    evidence: Evidence
    losses: Losses
    model: AbstractActuator
    folds: tuple[AbstractActuator, ...]

    @property
    def judged(self) -> bool:
        """Whether it was tried on unseen windows."""
        return bool(self.folds)


@dataclasses.dataclass(frozen=True)
class Ranking:
    """All candidates, best first; the loss of the model without any of them, and its fits to each fold.

    `stretch`: blocks in time over which the residuals of the best candidate go together.
    """

    loss: float
    folds: tuple[AbstractActuator, ...]
    candidates: tuple[Candidate, ...]
    stretch: int


def rank(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    meter: Meter,
) -> Ranking:
    """Rank the candidates that are not yet accepted.

    The model with each candidate is first fitted to everything (:func:`search`), which tells its valley. Then
    the present model and each candidate are fitted on all folds but one (:class:`Folds`), with all parameters
    that are free anyway, and judged on that one. A candidate that explains too little of the very windows
    that it was fitted to is not judged (:func:`_promising`).
    """
    rest = [effect for effect in bench.candidates if effect.name not in accepted]
    rest.sort(key=carries_state, reverse=True)  # what takes longest comes first
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    if accepted:
        meter.expect(round_work(rest, FOLDS))
    searched = on_all_cores(lambda effect: search(bench, model, accepted, effect, problem, meter), rest)
    present = bench.fit(model, accepted, problem, STEPS)[0]
    before, squares = _seen(bench, present, problem, block), _excess_squares(bench, present, problem)
    seen = [_seen(bench, found, problem, block) for found in searched]
    gains = [gain(before, own) for own in seen]
    falls = [(squares - _excess_squares(bench, found, problem)) / max(squares, 1.0) for found in searched]
    chosen = _promising([max(pair) for pair in zip(gains, falls, strict=True)])
    left = [
        Candidate(effect, Evidence(gained, 1.0, _typical(own)), own, found, ())
        for effect, gained, own, found, promises in zip(rest, gains, seen, searched, chosen, strict=True)
        if not promises
    ]
    best = min(zip(seen, searched, strict=True), key=lambda pair: float(pair[0].sum()))[1]
    folds = Folds(problem, block, _correlation(bench, best, problem, block))
    promising = [(e, m) for e, m, promises in zip(rest, searched, chosen, strict=True) if promises]
    models = [(model, list(accepted)), *((m, [*accepted, e.name]) for e, m in promising)]
    tasks = [(*entry, fold) for entry in models for fold in range(folds.count)]
    work = JUDGEMENT * (len(rest) + 1) / len(models)

    def judge(task: tuple[AbstractActuator, list[str], int]) -> tuple[Losses, AbstractActuator]:
        judged = folds.judged(bench, *task)
        meter.did(work, "judging all on windows that they were not fitted to")
        return judged

    judged, count = on_all_cores(judge, tasks), folds.count
    each = [judged[i : i + count] for i in range(0, len(judged), count)]
    losses = [folds.in_time([loss for loss, _ in parts]) for parts in each]
    refitted = [tuple(model for _, model in parts) for parts in each]
    evidence = compare(losses[0], losses[1:], folds.stretch)
    if any(told.too_few_stretches(len(accepted)) for told in evidence):
        evidence = _by_likelihood(bench, model, accepted, problem, promising, evidence, len(rest))
    tried = [
        Candidate(effect, told, own, found, models)
        for (effect, found), told, own, models in zip(
            promising, evidence, losses[1:], refitted[1:], strict=True
        )
    ]
    ranked = [*sorted(tried, key=_loss), *sorted(left, key=_loss)]
    return Ranking(_typical(losses[0]), refitted[0], tuple(ranked), folds.stretch)


def _by_likelihood(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    promising: Sequence[tuple[type[AbstractEffect], AbstractActuator]],
    evidence: Sequence[Evidence],
    tried: int,
) -> list[Evidence]:
    """The evidence, with the p-value of a likelihood ratio where too few stretches tell the models apart.

    Args:
        promising: candidates and models with them, fitted to everything.
        tried: candidates that were searched, which the p-value allows for (Bonferroni).
    """
    starts = (model, bench.with_card_values(model))
    before = bench.residuals(bench.best_fit(starts, accepted, problem, STEPS)[0], problem)
    found = []
    for (effect, larger), told in zip(promising, evidence, strict=True):
        if told.too_few_stretches(len(accepted)):
            after, parameters = bench.residuals(larger, problem), len(paths_of(larger, effect.name))
            p_value = tried * likelihood_ratio_test(before, after, problem.weights, parameters)
            told = dataclasses.replace(told, p_value=min(p_value, 1.0), test=LIKELIHOOD_RATIO)
        found.append(told)
    return found


def _seen(bench: Workbench, model: AbstractActuator, problem: Problem, block: Blocks) -> Losses:
    """Losses of `model` as it is, on windows that it may have been fitted to."""
    everything = np.arange(int(block.max()) + 1)
    return block_losses(bench.residuals(model, problem), problem.weights, block, everything)


def _excess_squares(bench: Workbench, model: AbstractActuator, problem: Problem) -> float:
    """Sum of the squared weighted residuals of `model` beyond what noise leaves, 1 for each reading."""
    readings = sum(int((np.asarray(w) > 0).sum()) for w in problem.weights.values())
    return 2 * bench.cost(model, problem) - readings


def _correlation(bench: Workbench, model: AbstractActuator, problem: Problem, block: Blocks) -> int:
    """Blocks in time over which the residuals of `model` go together."""
    return correlated_blocks(block_means(bench.residuals(model, problem), problem.weights, block))


def _typical(losses: Losses) -> float:
    return float(np.expm1(losses.mean()))


def _promising(gains: Sequence[float]) -> list[bool]:
    """Which candidates are judged on unseen windows.

    Args:
        gains: part of the excess error, or of the excess sum of squares if that is more, that each removes
            of the windows that it is fitted to.
    """
    order = np.argsort(-np.asarray(gains), kind="stable")
    least = 1 - FAR * (1 - max(gains, default=0.0))
    near = [gain >= least for gain in gains]
    first, most = set(order[:FIRST].tolist()), set(order[:MOST].tolist())
    return [gain >= PROMISING and i in most and (near[i] or i in first) for i, gain in enumerate(gains)]


def _loss(candidate: Candidate) -> float:
    return candidate.evidence.loss


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
        self, bench: Workbench, model: AbstractActuator, effects: Sequence[str], fold: int
    ) -> tuple[Losses, AbstractActuator]:
        """`model` fitted, with `effects`, to all folds but one, and its losses on that one."""
        judged = np.flatnonzero(self.fold_of == fold)
        fitting = self.problem.only(~np.isin(self.block, self._beside(judged)))
        fitted, _ = bench.fit(model, effects, fitting, STEPS, SLOW)
        residuals = bench.residuals(fitted, self.problem)
        return block_losses(residuals, self.problem.weights, self.block, judged), fitted

    def _beside(self, judged: NDArray[np.int64]) -> NDArray[np.int64]:
        """The judged blocks and those near them that are not fitted either."""
        gap = self.stretch // SAFE if self.stretch > 1 else 0
        near = judged[:, None] + np.arange(-gap, gap + 1)
        return np.unique(near)

    def in_time(self, losses: Sequence[Losses]) -> Losses:
        """Losses fold by fold, put into the order of time."""
        order = np.concatenate([np.flatnonzero(self.fold_of == fold) for fold in range(self.count)])
        return np.concatenate(losses, axis=1)[:, np.argsort(order)]


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
