"""Sequential replacement: an effect that was added before another against others that it was ranked with, and
against none (Miller, Subset Selection in Regression, 2nd ed., 2002, chapter 3).

What is added first explains most alone. Where two effects act at once, a third one may do that: an offset of
the pressure in the place of a bladder, as long as the force's drift is missing (0.67 and 0.68 of the excess
error alone; beside the drift 0.90 and 0.96). It may even do so significantly better: where the two leave
something, those that did worse alone are tried, too.
"""

from __future__ import annotations

from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_search import search, search_work
from jaxmuscle.diagnosis.candidates import Sought, without
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import blocks, compare
from jaxmuscle.diagnosis.folds import FOLDS, STEPS, Folds
from jaxmuscle.diagnosis.ranking import (
    JUDGEMENT,
    Candidate,
    Ranking,
    correlation,
    judged_all,
    rank,
    told_apart,
    typical,
    unseen_loss,
)
from jaxmuscle.diagnosis.rivals import WholeWindowFits, does_better
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import replace
from jaxmuscle.progress import Meter

MOST = 2
"""Effects that are tried in the place of one: those that did best alone."""


def others_for_its_place(
    ranking: Ranking, accepted: Sequence[str], something_is_left: bool
) -> list[type[AbstractEffect]]:
    """Effects from which the one that was added was not told apart, best first, and where something is left
    those that were supported; of a constant none.

    On joint 124074 of `blind_recordings.drawn` an offset of the angle explained more than the muscles'
    mismatch, significantly so, until the rate limit was there; with it 20 noise units were left held out.

    Args:
        ranking: of the search that added it, the first one in it, alone.
        accepted: names of all effects that the model has.
    """
    added, *others = ranking.candidates
    if isinstance(added.effects[0], CardConstant):
        return []
    worth = [
        each.effects[0]
        for each in others
        if each.judged and each.name not in accepted
        if not told_apart(each, added, ranking.stretch) or (something_is_left and each.evidence.supports(0))
    ]
    return [effect for effect in worth if not isinstance(effect, CardConstant)][:MOST]


def replacements(
    fits: WholeWindowFits,
    model: AbstractActuator,
    added: Candidate,
    tried: Sequence[type[AbstractEffect]],
    problem: Problem,
    meter: Meter,
) -> Ranking | None:
    """The ranking of the effects for a place beside those that were added later; `None` if there is one only.

    First stays the one that was added, unless another one is supported there and does better
    (:func:`~jaxmuscle.diagnosis.rivals.does_better`).

    Args:
        fits: of effects beside those that were added later, to whole windows.
        model: the present one, with all its effects; `added`: which of them stood in that place.
        tried: effects that may take it (:func:`others_for_its_place`).
        problem: the windows, as effects are searched and judged on them.
    """
    if not tried:
        return None
    bench, others = fits.bench, fits.accepted
    (effect,) = added.effects
    meter.expect(sum(search_work(each) for each in tried) + JUDGEMENT * FOLDS * (len(tried) + 2))
    bare = bench.dressed(replace(model, without(effect)), others)
    present = bench.settled(bare, others, problem, STEPS)
    bases = present.model, bench.with_card_values(present.model)
    searched = on_all_cores(lambda other: search(bench, bases, others, other, problem, present, meter), tried)
    hopeful = [pair for pair in zip(tried, searched, strict=True) if pair[1].hopeful]
    if not hopeful:
        return None
    own = bench.settled(model, [*others, effect.name], problem, STEPS)
    return _ranked(fits, present, [(effect, own), *hopeful], problem, meter)


def still_needed(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    meter: Meter,
) -> tuple[Ranking, AbstractActuator]:
    """The ranking of an effect for its place beside those that were added later, and the model without it.

    Where it is not supported there it only made up for what was missing until then: an offset of a lift's
    position for a backlash (lift 122125 of `blind_recordings.drawn`).

    Args:
        model, accepted: the present model and all its effects.
    """
    others = [name for name in accepted if name != effect.name]
    bare = bench.dressed(replace(model, without(effect)), others)
    return rank(bench, bare, others, [effect], problem, meter), bare


def _ranked(
    fits: WholeWindowFits,
    present: SettledFit,
    entries: Sequence[tuple[Sought, SettledFit]],
    problem: Problem,
    meter: Meter,
) -> Ranking:
    """The ranking of effects, the one that was added first, beside the others of the `present` model.

    Args:
        fits: of such effects to whole windows.
    """
    bench, others = fits.bench, fits.accepted
    best = min(
        (fitted for _, fitted in entries), key=lambda fitted: float(bench.losses(fitted.model, problem).sum())
    )
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    folds = Folds(problem, block, correlation(bench, best.model, problem, block))
    tried = [(present, list(others)), *((fitted, [*others, effect.name]) for effect, fitted in entries)]
    (bare, *losses), refitted = judged_all(bench, folds, tried, JUDGEMENT, meter)
    candidates = [
        Candidate((effect,), told, own, fitted.model, models)
        for (effect, fitted), told, own, models in zip(
            entries, compare(bare, losses, folds.stretch), losses, refitted[1:], strict=True
        )
    ]
    added, *rivals = candidates
    better = [
        each
        for each in rivals
        if each.evidence.supports(len(others)) and does_better(fits, each, added, folds.stretch)
    ]
    first = min(better, key=unseen_loss, default=added)
    rest = sorted((each for each in candidates if each is not first), key=unseen_loss)
    return Ranking(typical(bare), refitted[0], (first, *rest), folds.stretch)
