"""Search of one candidate effect: the valley of the model with it, from several strengths and shapes.

Work is counted in seconds of the sample `lift` on two cores, from nothing compiled.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import (
    Sought,
    carries_state,
    linear_strength,
    of_strength,
    shapes,
    strength_path,
    strengths,
)
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import blocks, telling_excess
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.workbench import SLOW, Goal, Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.progress import Meter

SEARCH, SEARCH_WITH_STATE = 0.2, 0.8
"""Search of one candidate, and of one with a state of its own."""
SEARCH_STEPS = (0.2, 0.3, 0.2, 0.3)
"""Parts of a search: first start, short fit from it, second start, fits to the end."""


def search_work(effect: Sought) -> float:
    """Work of the search of one candidate."""
    return SEARCH_WITH_STATE if carries_state(effect) else SEARCH


SHORT_STEPS, LONG_STEPS = 12, 60
"""Steps of the fit from each base, and of the better one of them to its end."""
HOPE, LEAST = 0.02, 2.0
"""Part of the excess error, and of the cost, that the short fits have to remove to be carried on: less than
half of what makes a candidate worth judging, and a likelihood ratio that no test takes for evidence."""
PLENTY = 0.2
"""Part of the excess error that is enough in any case. An error that lasts as long as the recording is worth
so few readings that the whole of it costs less than a likelihood ratio of evidence does: of a drift of the
load cell that left 5 noise units no candidate had hope."""
NEAR, PATIENCE = 0.25, 4
"""Part of that within which a short fit ends near a minimum, and steps in which it has to get so far."""


def search(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    present: SettledFit,
    meter: Meter,
) -> SettledFit:
    """`model` with `effect` added and everything fitted to `problem`.

    Two short fits are made, from the fitted model and from the values of the card, and the better one is
    carried on: the fitted model may be bent far to make up for what is missing, and then lies in a valley
    of its own. Each begins where the cost is least among several strengths of several shapes, with the
    weights of the `present` model, and ends as soon as too little (:data:`HOPE`) is within its reach. Where
    both remove too little the search ends without hope; else it goes on with weights from what is left.
    """
    return bench.kept(
        "search",
        model,
        [*accepted, effect.name],
        (len(accepted), problem, dataclasses.replace(present, model=bench.bare(present.model, accepted))),
        lambda: _search(bench, model, accepted, effect, problem, present, meter),
        lambda: meter.had(search_work(effect), f"trying {effect.name}"),
    )


def _search(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    present: SettledFit,
    meter: Meter,
) -> SettledFit:
    names = [*accepted, effect.name]
    work, parts, fits = search_work(effect), iter(SEARCH_STEPS), []
    weighed = problem.reweighted(present.factors)
    readings = sum(int((np.asarray(w) > 0).sum()) for w in problem.weights.values())
    noise = math.sqrt(present.noise_squares(problem) / max(readings, 1))
    needed = _needed(bench, present, problem)
    goal = Goal(present.cost - needed, NEAR * needed, PATIENCE)
    for base in (model, bench.with_card_values(model)):
        begin = _best_start(bench, bench.dressed(base, names), accepted, effect, weighed, noise)
        meter.did(next(parts) * work, f"trying {effect.name}")
        fits.append(bench.fit(begin, names, problem, SHORT_STEPS, SLOW, present.factors, goal))
        meter.did(next(parts) * work, f"trying {effect.name}")
    best, minimum = min(fits, key=lambda fit: fit[1].cost)
    if minimum.cost > goal.goal:
        return SettledFit(best, minimum.cost, minimum.code, present.left, 0.0, hopeful=False)
    return bench.settled(best, names, problem, LONG_STEPS, SLOW)


def _needed(bench: Workbench, present: SettledFit, problem: Problem) -> float:
    """Fall of the cost below that of the `present` model at which a candidate is worth a whole fit."""
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    residuals = bench.residuals(present.model, problem)
    excess = 0.5 * telling_excess(residuals, problem.weights, block, present.factors)
    return max(HOPE * excess, min(LEAST, PLENTY * excess))


def _best_start(
    bench: Workbench,
    base: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    noise: float,
) -> AbstractActuator:
    """`base` with the strength and shape of `effect` at which the cost is least."""
    path = strength_path(effect)
    tries = []
    for shape in shapes(effect):
        shaped = replace(base, shape)
        if path in shape:
            tries.append(shaped)
        else:
            found = _strengths(bench, shaped, accepted, effect, problem, noise)
            tries += [replace(shaped, of_strength(effect, strength, shaped)) for strength in found]
    return min(tries, key=lambda trial: bench.cost(trial, problem), default=base)


def _strengths(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    noise: float,
) -> list[float]:
    """Strengths over the whole range, and the one of a linear step with which the free parameters move."""
    path = strength_path(effect)
    # A constant that the card calls uncertain is free anyway, but held by its prior.
    own = [each for each in bench.free_paths(model, accepted) if each != path]
    residual, slopes = bench.jacobian(model, problem, [*own, path], [*accepted, effect.name])
    nonnegative = parameters(model)[path].nonnegative and not isinstance(effect, CardConstant)
    linear, _ = linear_strength(residual, slopes[: len(own)], slopes[len(own)])
    return [
        abs(linear) if nonnegative else linear,
        *strengths(slopes[len(own)], residual, nonnegative, noise),
    ]
