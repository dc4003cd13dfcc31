"""Last fit of a diagnosis: the values of what was found, and effects that this fit does not bear out."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought, signal_of, without
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.diagnosis_data import Estimate, FoundEffect, Round
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO
from jaxmuscle.diagnosis.folds import disagreement
from jaxmuscle.diagnosis.ranking import Candidate
from jaxmuscle.diagnosis.verdict import beyond_machines, doubted, strength_stds
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import strengths_of
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import NoFitError
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.fit import FitResult, Method, estimate
from jaxmuscle.estimation.prepare import DISCREPANCY
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parameter_names import of_effect
from jaxmuscle.parameters import replace
from jaxmuscle.simulation.sensor_errors import unloaded

FIT_STEPS = 60


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the search found: the two fitted models, what was added, the searches, fits to each fold.

    `masks`: column → rows whose readings count for nothing.
    """

    declared: AbstractActuator
    model: AbstractActuator
    found: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    folds: tuple[AbstractActuator, ...]
    converged: bool
    masks: Mapping[str, NDArray[np.bool_]]


@dataclasses.dataclass(frozen=True)
class BorneOut:
    """What of an outcome the last fit bears out.

    Attributes:
        outcome: with the values of that fit, without what was refused.
        fit: the last fit; `None` where nothing is free.
        refused: name of each effect that was taken out again → why.
        beyond_machines: those of them with a strength that no real machine has.
    """

    outcome: Outcome
    fit: FitResult | None
    refused: Mapping[str, str]
    beyond_machines: frozenset[str]


def borne_out(case: Case, bench: Workbench, training: Problem, outcome: Outcome) -> BorneOut:
    """The outcome with the values of the last fit, without effects that this fit does not bear out.

    An effect with which predictions from some window on are not numbers is none either: those that were
    added last are taken out until the others can be fitted. Held-out rows take no part.
    """
    refused: dict[str, str] = {}
    impossible: frozenset[str] = frozenset()
    while True:
        names = [candidate.name for candidate in outcome.found]
        try:
            final = _final_fit(case, bench, outcome, names)
        except NoFitError:
            if not names:
                raise
            refused[names[-1]] = "the last fit with it failed: its predictions are not numbers everywhere"
            outcome = _without(bench, training, outcome, names[-1:])
            continue
        if final is None:
            return BorneOut(outcome, None, refused, impossible)
        fitted = {entry.path: entry.value for entry in final.parameters.values()}
        outcome = dataclasses.replace(outcome, model=replace(outcome.model, fitted))
        strengths = {c.name: _strengths(c.effects[0]) for c in outcome.found}
        largest = {c.name: largest_strength(case, outcome.model, c.name) for c in outcome.found}
        found = [found_effect(c, _judging(c, final, outcome.folds)) for c in outcome.found]
        beyond = beyond_machines(found, strengths, largest)
        reasons = beyond | doubted(found, strengths)
        if not reasons:
            return BorneOut(outcome, final, refused, impossible)
        impossible |= beyond.keys()
        refused |= reasons
        outcome = _without(bench, training, outcome, reasons)


def largest_strength(case: Case, model: AbstractActuator, name: str) -> float | None:
    """Size of the strength of an effect that no real machine exceeds; `None` where none is known."""
    if name not in model.effects:
        return None  # a constant of the card
    rows = ~held_out_rows(case)
    duration = float(rows.sum()) * case.recording.step
    return model.effects[name].largest_on(duration, _ranges(case, model, rows))


def _ranges(case: Case, model: AbstractActuator, rows: NDArray[np.bool_]) -> dict[str, float]:
    """Name of the slot of each reading, of a column or of the chain → its range in some rows, with what an
    unloaded sensor shows among the values.
    """
    columns = {}
    for name in measured_columns(model):
        shown = np.append(case.filled.columns[name][rows], float(unloaded(model, name)))
        columns[f"{name}_reading"] = float(np.ptp(shown))
    chain = {
        slot.name: max(columns[f"{column}_reading"] for column in model.outputs[output])
        for slot, output in model.reading_slots().items()
    }
    return {**columns, **chain}


def _judging(
    candidate: Candidate, final: FitResult, folds: Sequence[AbstractActuator]
) -> dict[str, Estimate]:
    """Values with the standard deviations by which it is decided whether an effect is there.

    Those of the fit, with the effect's shapes held: of a decay whose end is not seen neither the size nor the
    time constant is determined by itself, and yet it is sure that something decays (joint 70022 of
    `blind_recordings.drawn`: share 0.049 +- 0.027, and +- 0.003 with the time constant held). By how much
    fits to the folds disagree counts in the same proportion, as they do along these shapes: a friction of 1.9
    +- 3 N m, by which folds of a joint disagreed and which helped on unseen stretches all the same, told too
    little of the machine to be named. Where a likelihood ratio judged, which takes the noise for what it
    seems to be, all of their disagreement counts.
    """
    held = strength_stds(final, candidate.name, _strengths(candidate.effects[0]))
    if candidate.evidence.test == LIKELIHOOD_RATIO:
        return estimates(final, folds, held)
    return estimates(final, (), {path: _with_folds(final, path, std, folds) for path, std in held.items()})


def _with_folds(final: FitResult, path: str, held: float, folds: Sequence[AbstractActuator]) -> float:
    """Standard deviation of a strength with its shapes held: of the fit, or by how much folds disagree."""
    alone = final.std[path]
    part = held / alone if 0 < alone < math.inf else 1.0
    return max(held, part * disagreement(folds, path))


def _without(bench: Workbench, training: Problem, outcome: Outcome, refused: Collection[str]) -> Outcome:
    """The outcome without some of its effects, everything else fitted again."""
    kept = tuple(candidate for candidate in outcome.found if candidate.name not in refused)
    gone = {p: v for c in outcome.found if c not in kept for p, v in without(c.effects[0]).items()}
    names = [candidate.name for candidate in kept]
    model = bench.dressed(replace(outcome.model, gone), names)
    fitted = bench.best_fit((model, bench.with_card_values(model)), names, training, FIT_STEPS)
    converged = outcome.converged and fitted.converged
    return dataclasses.replace(outcome, model=fitted.model, found=kept, folds=(), converged=converged)


def _final_fit(case: Case, bench: Workbench, outcome: Outcome, names: list[str]) -> FitResult | None:
    """The found model fitted as by :func:`jaxmuscle.fit`, without the held-out rows; `None` if all is known.

    It carries the other candidates at zero strength, so that the programs of the search serve it.
    """
    model = bench.dressed(outcome.model, names)
    free, priors = bench.free_paths(model, names), bench.shape_priors(model, names)
    if not free:
        return None
    freed = bench.freed(names)
    bounds = {path: (constant.lower, constant.upper) for path, constant in freed.items()}
    asked = Asked(free, priors={**priors, **dict.fromkeys(freed)}, bounds=bounds)
    held_out, none = held_out_rows(case), np.zeros(len(case.recording), dtype=bool)
    unused = {column: held_out | outcome.masks.get(column, none) for column in case.usable}
    program, given = bench.program(model, names), (case.recording,)
    found = estimate(model, given, asked, unused, Method(bench.loss, DISCREPANCY, program=program))
    lean = bench.bare(found.actuator, names)
    return dataclasses.replace(found, actuator=lean, actuators=(lean,))


def estimates(
    final: FitResult, folds: Sequence[AbstractActuator], std: Mapping[str, float] | None = None
) -> dict[str, Estimate]:
    """Values and standard deviations: those of the final fit, or by how much fits to the folds disagree.

    Args:
        std: name → standard deviation in the place of that of the fit.
    """
    return {
        name: Estimate(
            entry.value,
            max((std or {}).get(name, entry.std), disagreement(folds, entry.path)),
            entry.unit,
            entry.meaning,
        )
        for name, entry in final.parameters.items()
    }


def _strengths(sought: Sought) -> tuple[str, ...]:
    """Names of what tells how much of a candidate there is."""
    return (sought.quantity,) if isinstance(sought, CardConstant) else strengths_of(sought)


def held_out_rows(case: Case) -> NDArray[np.bool_]:
    """Rows that no fit and no choice may see."""
    held_out, windows = np.zeros(len(case.recording), dtype=bool), case.windows
    for row, mask in zip(windows.rows[windows.held_out], windows.mask[windows.held_out], strict=True):
        held_out[row + np.flatnonzero(mask)] = True
    return held_out


def found_effect(candidate: Candidate, values: dict[str, Estimate]) -> FoundEffect:
    """What a result tells of an effect that was added, with the values of its parameters."""
    (effect,) = candidate.effects
    if isinstance(effect, CardConstant):
        own = {effect.quantity: values[effect.quantity]}
        meaning = f"The card's value is not that of the machine: {effect.meaning}."
    else:
        own = of_effect(effect.name, values)
        meaning = (inspect.getdoc(effect) or "").splitlines()[0]
    return FoundEffect(
        name=effect.name,
        signal=signal_of(effect),
        meaning=meaning,
        source=effect.source,
        parameters=own,
        gain=candidate.evidence.gain,
        p_value=candidate.evidence.p_value,
        kind=effect.kind,
        column=effect.column,
        test=candidate.evidence.test,
        stretches=candidate.evidence.stretches,
        declared=effect.declared if isinstance(effect, CardConstant) else None,
        declared_std=effect.std if isinstance(effect, CardConstant) else None,
    )
