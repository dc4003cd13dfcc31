"""Search of candidate effects: the valley of the model with one of them, from several strengths and shapes.

Work is counted in seconds of the sample `lift` on two cores, from nothing compiled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

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
from jaxmuscle.diagnosis.settled_fit import SettledFit, best_of
from jaxmuscle.diagnosis.variable_projection import basis_of, outside_span, weighted_residuals
from jaxmuscle.diagnosis.workbench import PLENTY, SLOW, Goal, Workbench
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.progress import Meter

SEARCH, SEARCH_WITH_STATE = 0.2, 0.8
"""Search of one candidate, and of one with a state of its own."""
STARTED = 0.4
"""Part of the work on one base that is done when the strength to start with is found."""


def search_work(effect: Sought) -> float:
    """Work of the search of one candidate."""
    return SEARCH_WITH_STATE if carries_state(effect) else SEARCH


SHORT_STEPS, LONG_STEPS = 12, 60
"""Steps of the fit from each base, and of the better one of them to its end."""
HOPE, LEAST = 0.02, 2.0
"""Part of the excess error, and of the cost, that the short fits have to remove to be carried on: less than
half of what makes a candidate worth judging, and a likelihood ratio that no test takes for evidence."""
NEAR, PATIENCE = 0.25, 4
"""Part of that within which a short fit ends near a minimum, and steps in which it has to get so far."""


BENT = 2.0
"""Standard deviations of the card from which on a model counts as bent to make up for what it lacks: then all
candidates are searched from the card's values, too. On practice recordings that start led lower by what is of
use for the load friction and the bladder of 04 (3.1 standard deviations) and the gravity of 12 (0.7), in none
of the other 100 searches from models within two."""
AGAIN = 2
"""Candidates that are, of a model that is not bent: those that explain most. That of practice recording 12
leads to the better valley of the model without it."""


def search_all(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    effects: Sequence[Sought],
    problem: Problem,
    present: SettledFit,
    meter: Meter,
) -> list[SettledFit]:
    """The search of each candidate; from the card's values, too, where they may lead elsewhere."""
    card = bench.with_card_values(model)

    def found(effect: Sought, *bases: AbstractActuator) -> SettledFit:
        return search(bench, bases, accepted, effect, problem, present, meter)

    if bench.farthest_from_card(model) > BENT:
        return on_all_cores(lambda effect: found(effect, model, card), effects)
    searched = on_all_cores(lambda effect: found(effect, model), effects)
    costs = {i: bench.cost(each.model, problem) for i, each in enumerate(searched) if each.hopeful}
    best = sorted(costs, key=costs.__getitem__)[:AGAIN]
    meter.expect(sum(search_work(effects[i]) for i in best))
    # From both again: which of two short fits is carried on is told by their costs under the same weights.
    again = on_all_cores(lambda i: found(effects[i], model, card), best)
    for i, other in zip(best, again, strict=True):
        searched[i] = other
    return searched


def search(
    bench: Workbench,
    bases: Sequence[AbstractActuator],
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    present: SettledFit,
    meter: Meter,
) -> SettledFit:
    """The model with `effect` added and everything fitted to `problem`.

    A short fit is made from each of the `bases` (the fitted model, and the values of the card, as the fitted
    model may lie in a valley of its own), and the best one is carried on. Each begins where the cost is least
    among several strengths of several shapes, with the weights of the `present` model, and ends as soon as
    too little (:data:`HOPE`) is within its reach. Where all remove too little the search ends without hope;
    else it goes on with weights from what is left. Where that weighs little, it is done with weights by the
    sensors' noise, too (:func:`_by_sensor_noise`).
    """
    bare = [bench.bare(each, accepted) for each in (present.model, *bases)]
    return bench.kept(
        "search",
        bases[0],
        [*accepted, effect.name],
        (len(accepted), problem, dataclasses.replace(present, model=bare[0]), bare[1:]),
        lambda: _search(bench, bases, accepted, effect, problem, present, meter),
        lambda: meter.had(search_work(effect), f"trying {effect.name}"),
    )


def _search(
    bench: Workbench,
    bases: Sequence[AbstractActuator],
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    present: SettledFit,
    meter: Meter,
) -> SettledFit:
    names = [*accepted, effect.name]
    fits = []
    noise = present.noise_in_residuals(problem)
    needed = _needed(bench, present, problem)
    goal = Goal(present.cost - needed, NEAR * needed, PATIENCE)

    def did(part: float) -> None:
        meter.did(part * search_work(effect) / len(bases), f"trying {effect.name}")

    for base in bases:
        dressed = bench.dressed(base, names)
        # Whether a model knows an input is asked by the noise of its sensor, before weights allow for more.
        weighed = bench.seen_by(dressed, problem).reweighted(present.factors)
        begin = _best_start(bench, dressed, accepted, effect, weighed, noise)
        did(STARTED)
        fits.append(bench.fit(begin, names, problem, SHORT_STEPS, SLOW, present.factors, goal))
        did(1 - STARTED)
    best, minimum = min(fits, key=lambda fit: fit[1].cost)
    if minimum.cost > goal.goal and not bench.removes_plenty(present.model, best, problem):
        found = SettledFit(best, minimum.cost, minimum.code, present.left, 0.0, hopeful=False)
    else:
        found = bench.settled(best, names, problem, LONG_STEPS, SLOW)
    if not found.weighs_little:
        return found
    other = _by_sensor_noise(bench, bases[0], accepted, effect, problem, found.model)
    return found if other is None else other


def from_other_shapes(
    bench: Workbench,
    fitted: SettledFit,
    names: Sequence[str],
    effects: Sequence[Sought],
    problem: Problem,
) -> SettledFit:
    """A fit, or the better one to which shapes lead that searches of its `effects` begin with (multi-start).

    The best shape beside what is free at first need not lie in the best valley in the end: plays of a jet
    pipe were found twice as wide as they are, with a lag of its load cell beside them (125095 of
    `blind_recordings.drawn`).

    Strengths stay what they are, and so does an effect that has nothing else.

    Args:
        names: of all effects that the model has; `problem`: what it is fitted to.
    """
    starts = [shape for effect in effects for shape in shapes(effect) if strength_path(effect) not in shape]
    starts = [shape for shape in starts if shape]
    if not starts:
        return fitted
    begun = on_all_cores(
        lambda shape: bench.fit(
            replace(fitted.model, shape), names, problem, SHORT_STEPS, SLOW, fitted.factors
        ),
        starts,
    )
    model, lane = min(begun, key=lambda fit: fit[1].cost)
    if lane.cost >= fitted.cost:
        return fitted
    both = fitted, bench.settled(model, names, problem, LONG_STEPS)
    return both[best_of(both)]


def _by_sensor_noise(
    bench: Workbench,
    base: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    found: AbstractActuator,
) -> SettledFit | None:
    """The model that a fit with weights by the noise of the sensors leads to; `None` unless it removes plenty
    of what `found` leaves, and of what the model without the effect leaves after such a fit.

    To be asked for where what `found` leaves weighs little, or the search ended without hope.
    """
    names = [*accepted, effect.name]
    dressed = bench.dressed(base, names)
    begin = _best_start(bench, dressed, accepted, effect, bench.seen_by(dressed, problem), 1.0)
    other = bench.by_sensor_noise(begin, names, problem, SHORT_STEPS)
    if not bench.removes_plenty(found, other.model, problem):
        return None
    bare = bench.by_sensor_noise(bench.dressed(base, accepted), accepted, problem, SHORT_STEPS)
    return other if bench.removes_plenty(bare.model, other.model, problem) else None


def _needed(bench: Workbench, present: SettledFit, problem: Problem) -> float:
    """Fall of the cost below that of the `present` model at which a candidate is worth a whole fit."""
    block = blocks(len(problem.rows), problem.samples, int(problem.period))
    residuals = bench.residuals(present.model, problem)
    excess = 0.5 * telling_excess(residuals, problem.weights, block, present.factors, bench.loss)
    return max(HOPE * excess, min(LEAST, PLENTY * excess))


def _best_start(
    bench: Workbench,
    base: AbstractActuator,
    accepted: Sequence[str],
    effect: Sought,
    problem: Problem,
    noise: float,
) -> AbstractActuator:
    """`base` with the strength and shape of `effect` at which least is left that a linear step of the free
    parameters does not take over (variable projection).

    By the cost with these held, a force that decays within seconds looked worse than one that does so in ten
    minutes: for what it has lost on average, which a radius makes up for.
    """
    path = strength_path(effect)
    # A constant that the card calls uncertain is free anyway, but held by its prior.
    paths = [*(each for each in bench.free_paths(base, accepted) if each != path), path]
    nonnegative = parameters(base)[path].nonnegative and not isinstance(effect, CardConstant)
    tries = []
    for shape in shapes(effect):
        shaped = replace(base, shape)
        residual, slopes = bench.jacobian(shaped, problem, paths, [*accepted, effect.name])
        trials = [shaped]
        if path not in shape:
            found = _strengths(residual, slopes, nonnegative, noise)
            trials = [replace(shaped, of_strength(effect, strength, shaped)) for strength in found]
        basis, far = basis_of(slopes[:-1]), residual[len(residual) - len(paths) :]
        rests = [outside_span(basis, weighted_residuals(trial, problem, far)) for trial in trials]
        tries += [(float(rest @ rest), trial) for rest, trial in zip(rests, trials, strict=True)]
    return min(tries, key=lambda pair: pair[0], default=(0.0, base))[1]


def _strengths(
    residual: Float[np.ndarray, " n"], slopes: Float[np.ndarray, "k n"], nonnegative: bool, noise: float
) -> list[float]:
    """Strengths over the whole range, and the one of a linear step with which the free parameters move.

    Args:
        slopes: of the residuals by the free parameters, and last by the strength.
    """
    linear, _ = linear_strength(residual, slopes[:-1], slopes[-1])
    return [abs(linear) if nonnegative else linear, *strengths(slopes[-1], residual, nonnegative, noise)]
