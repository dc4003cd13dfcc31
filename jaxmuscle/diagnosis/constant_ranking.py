"""Constants of the card ranked beside effects, by the same search and the same evidence."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import TOLD_APART, compare
from jaxmuscle.diagnosis.pairs import needed
from jaxmuscle.diagnosis.ranking import Candidate, Ranking, rank, unseen_loss
from jaxmuscle.diagnosis.verdict import VIOLATED
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parameters import get
from jaxmuscle.progress import Meter

MOST_OF_IT = 0.5
"""Part of the excess error on unseen windows that a constant has to remove. One that is wrong explains all
that it is the cause of; with less it imitates something else, as a braid angle can a part of any force."""


def rank_with_constants(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effects: Sequence[Sought],
    problem: Problem,
    meter: Meter,
    among: int = 0,
) -> Ranking:
    """Rank `effects` and, beside them, constants; effects come first unless a constant is clearly better.

    Clearly better is a constant (:func:`is_clear`) that is supported by unseen windows at the limit of one
    effect more, since it is one more chance to be misled, and removes most of what is missing. Where an
    effect is supported too, the constant has to predict unseen windows significantly better, and by as much
    as makes a second effect of a pair needed. Otherwise it stays a runner-up, which may not be told apart.

    Args:
        among: effects that were tried for this place, if more than these.
    """
    ranking = rank(bench, model, accepted, effects, problem, meter, among) if effects else None
    left = [constant for constant in bench.constants if constant.name not in accepted]
    if not left:
        if ranking is None:
            raise ValueError("expected a candidate that is not yet accepted")
        return ranking
    constants = rank(bench, model, accepted, left, problem, meter)
    return constants if ranking is None else beside(ranking, constants, len(accepted))


def beside(effects: Ranking, constants: Ranking, found: int) -> Ranking:
    """One ranking of both; those that were tried on unseen windows before the others.

    Args:
        found: candidates that were added before.
    """
    best = constants.candidates[0]
    if is_clear(best, effects, found):
        first, of = best, dataclasses.replace(constants, valley=effects.valley)
    else:
        first, of = effects.candidates[0], effects
    rest = [each for each in (*effects.candidates, *constants.candidates) if each is not first]
    rest.sort(key=lambda each: (not each.judged, unseen_loss(each)))
    return dataclasses.replace(of, candidates=(first, *rest))


def is_clear(best: Candidate, effects: Ranking, found: int) -> bool:
    """Whether a constant comes before all effects; see :func:`rank_with_constants`."""
    if not explains(best, found):
        return False
    rival = effects.supported(found)
    if rival is None:
        return True
    (told,) = compare(rival.losses, [best.losses], effects.stretch)
    return told.p_value < TOLD_APART and needed(rival.losses, best.losses)


def explains(candidate: Candidate, found: int) -> bool:
    """Whether its constants are the cause: supported, for most of what is missing, against the card.

    Effects without a constant need no more than their evidence.
    """
    constants = [each for each in candidate.effects if isinstance(each, CardConstant)]
    if not constants:
        return True
    if not candidate.judged:
        return False
    contradicts = all(
        abs(float(get(candidate.model, each.path)) - each.declared) > VIOLATED * (each.std or 0.0)
        for each in constants
    )
    return contradicts and candidate.evidence.gain >= MOST_OF_IT and candidate.evidence.supports(found + 1)
