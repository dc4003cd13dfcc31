"""Evidence by a likelihood ratio, where too few stretches of a recording tell models apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought, paths_of, strength_path, without
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO, Evidence
from jaxmuscle.diagnosis.folds import STEPS, disagreement
from jaxmuscle.diagnosis.likelihood_ratio import likelihood_ratio_test
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.verdict import SURE
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parameters import get

NOTICEABLE = 1.5
"""Mean square of the weighted residuals below which fits to the folds have to agree on the strength of an
effect before a likelihood ratio may say that it is there.

A clean lift that leaves 1.2, in four stretches at the turns of its friction, had a load friction of 0.06 N,
p = 9e-12, on which the folds disagree by 0.04 N; on practice recording 04, which leaves as much, it is 20.6 N
and 0.5 N.
"""


def by_likelihood(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    promising: Sequence[tuple[tuple[Sought, ...], SettledFit]],
    refitted: Sequence[Sequence[AbstractActuator]],
    evidence: Sequence[Evidence],
    tried: int,
) -> list[Evidence]:
    """The evidence, with the p-value of a likelihood ratio where too few stretches tell the models apart.

    Where the present model leaves less than :data:`NOTICEABLE`, and the folds do not agree that there is
    such an effect, it stays as it is: a likelihood ratio takes the noise for what it seems to be, and
    friction can make a few stretches of next to nothing stand out.

    Args:
        promising: candidates and models with them, fitted to everything; `refitted`: to each fold.
        tried: candidates that were searched, which the p-value allows for (Bonferroni).
    """
    starts = (model, bench.with_card_values(model))
    present = bench.best_fit(starts, accepted, problem, STEPS).model
    little = max(bench.mean_squares(present, problem).values()) < NOTICEABLE
    before = bench.residuals(present, problem)
    found = []
    for (effects, larger), folds, told in zip(promising, refitted, evidence, strict=True):
        doubtful = little and not all(_agreed(larger.model, folds, effect) for effect in effects)
        if told.too_few_stretches(len(accepted)) and not doubtful:
            after = bench.residuals(larger.model, problem)
            parameters = sum(len(paths_of(larger.model, effect.name)) for effect in effects)
            p_value = tried * likelihood_ratio_test(before, after, problem.weights, parameters)
            told = dataclasses.replace(told, p_value=min(p_value, 1.0), test=LIKELIHOOD_RATIO)
        found.append(told)
    return found


def _agreed(model: AbstractActuator, folds: Sequence[AbstractActuator], sought: Sought) -> bool:
    """Whether fits to the folds agree that a candidate is there: its strength is surely not zero."""
    path = strength_path(sought)
    strength = float(get(model, path)) - without(sought)[path]
    return abs(strength) > SURE * disagreement(folds, path)
