"""Evidence by a likelihood ratio, where too few stretches of a recording tell models apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought, paths_of
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO, Evidence
from jaxmuscle.diagnosis.folds import STEPS
from jaxmuscle.diagnosis.likelihood_ratio import likelihood_ratio_test
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.windows import Problem


def by_likelihood(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    problem: Problem,
    promising: Sequence[tuple[tuple[Sought, ...], SettledFit]],
    evidence: Sequence[Evidence],
    tried: int,
    found: int,
    times: int = 1,
) -> list[Evidence]:
    """The evidence, with the p-value of a likelihood ratio where too few stretches tell the models apart.

    Args:
        promising: candidates and models with them, fitted to everything.
        tried: candidates that were searched, which the p-value allows for (Bonferroni).
        found: effects that were found before the last one of these; evidence has to be enough after so many.
        times: what p-values of sign flips are multiplied by.
    """
    starts = (model, bench.with_card_values(model))
    present = bench.best_fit(starts, accepted, problem, STEPS).model
    before = bench.residuals(present, problem)
    judged = []
    for (effects, larger), told in zip(promising, evidence, strict=True):
        if told.too_few_stretches(found, times):
            after = bench.residuals(larger.model, problem)
            parameters = sum(len(paths_of(larger.model, effect.name)) for effect in effects)
            p_value = tried * likelihood_ratio_test(before, after, problem.weights, parameters)
            told = dataclasses.replace(told, p_value=min(p_value, 1.0), test=LIKELIHOOD_RATIO)
        judged.append(told)
    return judged
