"""Ranking of candidate effects by cross-validation: fitted on some windows, judged on the others.

Work is counted in seconds of the sample `lift` on two cores, from nothing compiled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_search import search_all, search_work
from jaxmuscle.diagnosis.candidates import Sought, paths_of, without
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import (
    TOLD_APART,
    Blocks,
    Evidence,
    Losses,
    block_means,
    blocks,
    compare,
    correlated_blocks,
    gain,
    telling_excess,
)
from jaxmuscle.diagnosis.folds import FOLDS, STEPS, Folds
from jaxmuscle.diagnosis.likelihood_evidence import by_likelihood
from jaxmuscle.diagnosis.settled_fit import SettledFit, best_of
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import FAILED
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import replace
from jaxmuscle.progress import Meter

DECLARED = 13.0
"""First fit of the declared model, and all that a search runs compiled beside it; two more fits."""
CONCLUSION = 8.0
"""Last fit, held-out predictions, what is unexplained: half of it is compilation."""
JUDGEMENT = 0.07
"""A fit to one fold, and its judgement."""
REFIT = 0.1


def round_work(effects: Sequence[Sought], folds: int) -> float:
    """Work of a round that tries `effects` and judges them, and the model without them, on `folds` folds."""
    searched = sum(search_work(effect) for effect in effects)
    return searched + JUDGEMENT * folds * (len(effects) + 1)


PROMISING = 0.05
"""Part of the excess error that a candidate has to remove on the windows that it is fitted to, to be judged
on others."""
FAR, FIRST = 2.0, 3
"""A candidate that leaves so many times as much excess error as the best one, where it is fitted, is not
judged on other windows either, unless it is among the first so many."""
MOST = 5
"""Candidates that are judged on other windows at most: those that explain most where they are fitted."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An effect, or several, how well they predict unseen windows, and the models fitted with them.

    `model`: to all blocks; `folds`: to all but those of one fold, fold by fold. Without folds it was not
    tried on unseen windows: its evidence is that of the windows it was fitted to, and too little. `failed`:
    predictions with it were not numbers, and the evidence is none.
    """

    effects: tuple[Sought, ...]
    evidence: Evidence
    losses: Losses
    model: AbstractActuator
    folds: tuple[AbstractActuator, ...]
    failed: bool = False

    @property
    def name(self) -> str:
        """Names of its effects."""
        return " + ".join(effect.name for effect in self.effects)

    def apart(self) -> list[Candidate]:
        """Its effects one by one, with the evidence of all of them."""
        return [dataclasses.replace(self, effects=(effect,)) for effect in self.effects]

    @property
    def has_constant(self) -> bool:
        """Whether a constant of the card is among its effects."""
        return any(isinstance(effect, CardConstant) for effect in self.effects)

    @property
    def judged(self) -> bool:
        """Whether it was tried on unseen windows."""
        return bool(self.folds)


@dataclasses.dataclass(frozen=True)
class Ranking:
    """All candidates, best first; the loss of the model without any of them, and its fits to each fold.

    `stretch`: blocks in time over which the residuals of the best candidate go together. `valley`: the
    present model where a candidate led to a better fit of it.
    """

    loss: float
    folds: tuple[AbstractActuator, ...]
    candidates: tuple[Candidate, ...]
    stretch: int
    valley: AbstractActuator | None = None

    def supported(self, found: int) -> Candidate | None:
        """The best candidate, if unseen windows support it; `found`: effects that were added before."""
        best = self.candidates[0] if self.candidates else None
        return best if best is not None and best.evidence.supports(found) else None


def rank(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    candidates: Sequence[Sought],
    problem: Problem,
    meter: Meter,
    among: int = 0,
) -> Ranking:
    """Rank the `candidates` for a model that has `accepted`.

    The model with each candidate is first fitted to everything (:func:`search`), which tells its valley. Then
    the present model and each candidate are fitted on all folds but one (:class:`Folds`), with all parameters
    that are free anyway, and judged on that one. A candidate that explains too little of the very windows
    that it was fitted to is not judged (:func:`_promising`).

    Args:
        among: candidates that were tried for this place, if more than these: evidence allows for them.
    """
    rest = bench.in_turns(candidates)
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    if accepted:
        meter.expect(round_work(rest, FOLDS))
    present = bench.settled(model, accepted, problem, STEPS)
    searched = search_all(bench, model, accepted, rest, problem, present, meter)
    begun, present = present, _at_its_best(bench, accepted, problem, block, present, rest, searched)
    valley = None if present is begun else present.model
    cost, missed = bench.cost(present.model, problem), _missed(bench, present.model, problem, block)
    before = bench.losses(present.model, problem)
    seen = [bench.losses(found.model, problem) for found in searched]
    gains = [gain(before, own) for own in seen]
    falls = [2 * (cost - bench.cost(found.model, problem)) / missed if missed else 0.0 for found in searched]
    chosen = _promising([max(pair) for pair in zip(gains, falls, strict=True)])
    left = [
        Candidate((effect,), Evidence(gained, 1.0, typical(own)), own, found.model, (), found.code == FAILED)
        for effect, gained, own, found, promises in zip(rest, gains, seen, searched, chosen, strict=True)
        if not promises
    ]
    best = min(zip(seen, searched, strict=True), key=lambda pair: float(pair[0].sum()))[1]
    folds = Folds(problem, block, correlation(bench, best.model, problem, block))
    promising = [((e,), m) for e, m, promises in zip(rest, searched, chosen, strict=True) if promises]
    models = [(present, list(accepted)), *((m, [*accepted, e.name]) for (e,), m in promising)]
    losses, refitted = judged_all(bench, folds, models, JUDGEMENT * (len(rest) + 1) / len(models), meter)
    evidence = compare(losses[0], losses[1:], folds.stretch)
    if any(told.too_few_stretches(len(accepted)) for told in evidence):
        among = max(among, len(rest))
        evidence = by_likelihood(bench, model, accepted, problem, promising, evidence, among, len(accepted))
    tried = [
        Candidate(effects, told, own, found.model, models)
        for (effects, found), told, own, models in zip(
            promising, evidence, losses[1:], refitted[1:], strict=True
        )
    ]
    further = lambda candidate: bench.worst_mean_square(candidate.model, problem.in_parts(1))  # noqa: E731
    first = simplest_first(sorted(tried, key=unseen_loss), len(accepted), further, folds.stretch)
    ranked = [*first, *sorted(left, key=unseen_loss)]
    return Ranking(typical(losses[0]), refitted[0], tuple(ranked), folds.stretch, valley)


def judged_all(
    bench: Workbench,
    folds: Folds,
    models: Sequence[tuple[SettledFit, list[str]]],
    work: float,
    meter: Meter,
) -> tuple[list[Losses], list[tuple[AbstractActuator, ...]]]:
    """Losses of models, each with the names of its effects, on unseen windows, and their fits to each fold.

    Args:
        work: what is done with the judgement of one model on one fold.
    """
    tasks = [(*entry, fold) for entry in models for fold in range(folds.count)]

    def judge(task: tuple[SettledFit, list[str], int]) -> tuple[Losses, AbstractActuator]:
        judged = folds.judged(bench, *task)
        meter.did(work, "judging all on windows that they were not fitted to")
        return judged

    judged, count = on_all_cores(judge, tasks), folds.count
    each = [judged[i : i + count] for i in range(0, len(judged), count)]
    losses = [folds.in_time([loss for loss, _ in parts]) for parts in each]
    return losses, [tuple(model for _, model in parts) for parts in each]


def _at_its_best(
    bench: Workbench,
    accepted: Sequence[str],
    problem: Problem,
    block: Blocks,
    present: SettledFit,
    effects: Sequence[Sought],
    searched: Sequence[SettledFit],
) -> SettledFit:
    """The present model, or a better fit of it where the one with the best candidate leads.

    A candidate's search may find a better valley in which its strength is next to none: what is gained there
    is no merit of the effect.
    """
    hopeful = [pair for pair in zip(effects, searched, strict=True) if pair[1].hopeful]
    if not hopeful:
        return present
    effect, found = hopeful[best_of([fitted for _, fitted in hopeful])]
    bare = bench.dressed(replace(found.model, without(effect)), accepted)
    other = bench.settled(bare, accepted, problem, STEPS)
    fall = 2 * (bench.cost(present.model, problem) - bench.cost(other.model, problem))
    deeper = fall > DEEPER * max(_missed(bench, present.model, problem, block), 1.0)
    return other if deeper and best_of([present, other]) else present


DEEPER = 0.05
"""Part of the excess error by which a fit of the same model has to leave less to lie in a better valley."""


def _missed(bench: Workbench, model: AbstractActuator, problem: Problem, block: Blocks) -> float:
    """Sum of squares beyond noise where `model` misses, of which the falls of others are parts."""
    return telling_excess(bench.residuals(model, problem), problem.weights, block)


def correlation(bench: Workbench, model: AbstractActuator, problem: Problem, block: Blocks) -> int:
    """Blocks in time over which the residuals of `model` go together."""
    return correlated_blocks(block_means(bench.residuals(model, problem), problem.weights, block))


def typical(losses: Losses) -> float:
    """Typical mean square of the weighted residuals, 1 being what noise leaves."""
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


AS_GOOD = 0.01
"""Difference of two gains below which the effect of fewer parameters comes first.

A creep whose times run down to nothing is a bladder's stiffness: on practice recording 08 both remove 0.99.
"""


FURTHER = 2.0
"""Ratio of what two candidates leave over whole windows below which they are as good there.

A joint with thread friction of 600 noise units: over the quarters of the windows on which candidates are
judged load friction removes 100 %, too; over whole windows it leaves 13.6 mean squares, thread friction 0.8.
"""


def simplest_first(
    ranked: Sequence[Candidate], found: int, left: Callable[[Candidate], float], stretch: int
) -> list[Candidate]:
    """Candidates, best first, but of those that are as good as the best one the simplest comes before it.

    As good is one whose gain is nearly the same, that is supported if the best one is, after so many
    effects `found`, whose predictions go on as well, and from which the best one is not told apart.

    Args:
        left: what a candidate leaves over whole windows, 1 being what noise leaves.
        stretch: blocks in time over which residuals go together.
    """
    if not ranked:
        return []
    best = ranked[0].evidence
    as_good = [
        each
        for each in ranked
        if abs(best.gain - each.evidence.gain) < AS_GOOD
        and each.evidence.supports(found) == best.supports(found)
    ]
    if len(as_good) > 1:
        most = FURTHER * max(left(ranked[0]), 1.0)
        as_good = [
            each
            for each in as_good
            if each is ranked[0] or (left(each) <= most and not told_apart(each, ranked[0], stretch))
        ]
    first = min(as_good, key=lambda each: sum(len(paths_of(each.model, e.name)) for e in each.effects))
    return [first, *(each for each in ranked if each is not first)]


def told_apart(candidate: Candidate, best: Candidate, stretch: int) -> bool:
    """Whether `best` predicts unseen windows significantly better than another candidate."""
    if candidate is best:
        return False
    return compare(candidate.losses, [best.losses], stretch)[0].p_value < TOLD_APART


def unseen_loss(candidate: Candidate) -> float:
    """What candidates are ordered by."""
    return candidate.evidence.loss
