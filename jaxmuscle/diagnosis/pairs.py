"""Pairs of effects: tried together where no single one is supported and much is missing.

Of two effects that act at once either one alone may explain little, and what it leaves goes together over so
long a time that few stretches tell it apart from none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TypeAlias

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_search import search
from jaxmuscle.diagnosis.candidates import Sought
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import (
    HALVED,
    Losses,
    blocks,
    compare,
    gain,
    sign_flip_bound,
    typical_fall,
)
from jaxmuscle.diagnosis.folds import FOLDS, STEPS, Folds
from jaxmuscle.diagnosis.likelihood_evidence import by_likelihood
from jaxmuscle.diagnosis.ranking import (
    JUDGEMENT,
    Candidate,
    Ranking,
    correlation,
    judged_all,
    round_work,
    told_apart,
)
from jaxmuscle.diagnosis.screening import parts_removed
from jaxmuscle.diagnosis.settled_fit import SettledFit, best_of
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.progress import Meter

LEADERS = 2
"""Single candidates, the best ones, that every other one is tried beside."""
BESIDE = 8
"""Candidates of a last pass that are tried beside a leader: those that a screening says may remove most of
what it leaves; of the usual ones all are. With all the forty of a last pass that took half an hour on a
joint. Those that do best alone are others: the stop beside a muscle's thick wall was not among them
(lift 70017 of `blind_recordings.drawn`: 7.3 noise units left, 1.05 with both)."""
NEEDED = 0.2
"""Part of the excess error that a pair has to remove, on unseen windows, of what a single effect leaves:
either of its own, or the best one; or it halves the error."""
NEARLY, MOST = 0.95, 2
"""Part of what the best pair removes of the excess error, where it is fitted, which others have to remove to
be judged beside it; and so many of them at most. An offset of a joint's angle (0.05 rad) and a mismatch of
its muscles (3 %), each beside an end stop, explain the same."""


Pair: TypeAlias = tuple[tuple[Sought, ...], SettledFit]


def best_pairs(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    ranking: Ranking,
    problem: Problem,
    meter: Meter,
) -> Ranking:
    """The pair that explains most where it is fitted, if both are needed, and those like it; or none.

    Effects stand beside effects, and beside the constants of the card that do best: where a scale was misread
    and a guide rubs, neither shows alone. It also has to do better, by :data:`NEEDED`, than the best single
    candidate. Its p-value allows for all pairs of a leader (Bonferroni). Beside a pair with a constant are
    those of its effect with another constant. Of pairs that explain nearly as much, the one with most effects
    of the usual catalogue comes first, if no other predicts unseen windows significantly better.

    Args:
        model, accepted: the present model and its effects, of which `ranking` is.
    """
    judged = [candidate for candidate in ranking.candidates if candidate.judged]
    leaders = [each for each in judged if not each.has_constant][:LEADERS]
    leaders += [each for each in judged if each.has_constant][:LEADERS]
    sought = bench.sought(accepted, much_is_left=True)
    if not any(effect not in leader.effects for leader in leaders for effect in sought):
        return _only(ranking, [], ranking.stretch)
    meter.expect(4 * JUDGEMENT * FOLDS)
    pairs = [pair for leader in leaders for pair in _beside(bench, accepted, leader, sought, problem, meter)]
    hopeful = [pair for pair in pairs if pair[1].hopeful]
    if not hopeful:
        return _only(ranking, [], ranking.stretch)
    best = hopeful[best_of([fitted for _, fitted in hopeful])]
    alike = [pair for pair in hopeful if pair is not best and _same_but_for_a_constant(pair, best)]
    alike += _near(bench, model, [*alike, best], hopeful, best, problem)
    tried = len(leaders) * len(sought)
    first, *others = (
        _judged(bench, model, accepted, ranking, problem, *pair, tried, meter) for pair in (best, *alike)
    )
    judged = [] if first is None else [first, *(each for each in others if each is not None)]
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    stretch = correlation(bench, best[1].model, problem, block)
    return _only(ranking, usual_first(judged, len(accepted) + 1, stretch), stretch)


def _only(ranking: Ranking, pairs: Sequence[Candidate], stretch: int) -> Ranking:
    """The ranking of pairs in the place of single effects.

    `stretch`: blocks over which the residuals of the best pair go together. What a single effect leaves does
    over longer ones, of which too few would tell it apart from the pair.
    """
    return dataclasses.replace(ranking, candidates=tuple(pairs), stretch=stretch)


def _near(
    bench: Workbench,
    model: AbstractActuator,
    but: Sequence[Pair],
    pairs: Sequence[Pair],
    best: Pair,
    problem: Problem,
) -> list[Pair]:
    """Pairs of other effects that remove nearly as much of the excess error as the best one, best first."""
    before = bench.losses(model, problem)
    least = NEARLY * gain(before, bench.losses(best[1].model, problem))
    parts: dict[frozenset[str], tuple[float, Pair]] = {}
    for pair in pairs:
        names, part = _names(pair), gain(before, bench.losses(pair[1].model, problem))
        if part >= max(least, parts[names][0] if names in parts else 0.0):
            parts[names] = part, pair
    for pair in but:
        parts.pop(_names(pair), None)
    return [pair for _, pair in sorted(parts.values(), key=lambda each: -each[0])][:MOST]


def _names(pair: Pair) -> frozenset[str]:
    return frozenset(effect.name for effect in pair[0])


def usual_first(pairs: Sequence[Candidate], found: int, stretch: int) -> list[Candidate]:
    """The pair with most usual effects of those that are as good as the first of `pairs`, then the others.

    As good is one that is supported if the first one is, after so many effects `found`, and that this one is
    not told apart from.
    """
    if not pairs:
        return []
    best, *others = pairs
    as_good = [
        each
        for each in others
        if each.evidence.supports(found) == best.evidence.supports(found)
        if not told_apart(each, best, stretch)
    ]
    first = min((best, *as_good), key=lambda each: sum(effect not in CATALOGUE for effect in each.effects))
    return [first, *(each for each in pairs if each is not first)]


def _same_but_for_a_constant(one: Pair, other: Pair) -> bool:
    """Whether two pairs are of one effect, each with a constant of its own."""
    (first, effect), (second, of) = one[0], other[0]
    return effect is of and isinstance(first, CardConstant) and isinstance(second, CardConstant)


def needed(single: Losses, both: Losses) -> bool:
    """Whether a pair does better than a single effect."""
    return gain(single, both) >= NEEDED or typical_fall(single, both) >= HALVED


def _beside(
    bench: Workbench,
    accepted: Sequence[str],
    leader: Candidate,
    sought: Sequence[type[AbstractEffect]],
    problem: Problem,
    meter: Meter,
) -> list[Pair]:
    """Other candidates beside `leader`, fitted to everything: each, or if they are many those of promise."""
    names = [*accepted, leader.name]
    present = bench.settled(leader.model, names, problem, STEPS)
    bases = present.model, bench.with_card_values(present.model)
    others = [effect for effect in sought if effect not in leader.effects]
    if len(others) > len(CATALOGUE):
        parts = parts_removed(bench, names, others, problem, present)
        others = [
            effect for _, effect in sorted(zip(parts, others, strict=True), key=lambda e: -e[0])[:BESIDE]
        ]
    meter.expect(round_work(others, 0))
    found = on_all_cores(
        lambda effect: search(bench, bases, names, effect, problem, present, meter),
        others,
    )
    return [((*leader.effects, effect), fitted) for effect, fitted in zip(others, found, strict=True)]


def _judged(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    ranking: Ranking,
    problem: Problem,
    effects: tuple[Sought, ...],
    found: SettledFit,
    tried: int,
    meter: Meter,
) -> Candidate | None:
    """A pair with its evidence on unseen windows; `None` if a single effect does nearly as well."""
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    folds = Folds(problem, block, correlation(bench, found.model, problem, block))
    rivals = [c for c in ranking.candidates if c.effects[0] in effects or c is ranking.candidates[0]]
    models = [
        (bench.settled(model, accepted, problem, STEPS), list(accepted)),
        *(
            (bench.settled(rival.model, [*accepted, rival.name], problem, STEPS), [*accepted, rival.name])
            for rival in rivals
        ),
        (found, [*accepted, *(effect.name for effect in effects)]),
    ]
    (without, *singles, both), refitted = judged_all(bench, folds, models, JUDGEMENT, meter)
    if not all(needed(single, both) for single in singles):
        return None
    (told,) = compare(without, [both], folds.stretch)
    before = len(accepted) + 1
    if told.too_few_stretches(before, tried):
        pair = [(effects, found)]
        (told,) = by_likelihood(bench, model, accepted, problem, pair, [told], tried, before, tried)
    else:
        # The flips that are drawn tell no p-value so small that it could be multiplied by dozens of pairs.
        p_value = min(told.p_value, sign_flip_bound(without, both, folds.stretch))
        told = dataclasses.replace(told, p_value=min(tried * p_value, 1.0))
    return Candidate(effects, told, both, found.model, refitted[-1])
