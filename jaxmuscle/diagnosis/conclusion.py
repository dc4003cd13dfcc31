"""Conclusion of a diagnosis: the last fit, effects that it does not bear out, held-out errors, the verdict.

The only place where held-out rows are looked at.
"""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought, signal_of, without
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.dependence import unexplained
from jaxmuscle.diagnosis.diagnosis_data import Estimate, FoundEffect, Round, Traces
from jaxmuscle.diagnosis.discrepancy import missing_rates
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO
from jaxmuscle.diagnosis.folds import disagreement
from jaxmuscle.diagnosis.partial_residual import reveal
from jaxmuscle.diagnosis.prediction_errors import errors, noise_of, predicted_columns, training_squares
from jaxmuscle.diagnosis.ranking import Candidate
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.settled_fit import SETTLED
from jaxmuscle.diagnosis.verdict import (
    IMITATED,
    MISSING,
    confirmed,
    doubted,
    far_off,
    missing_in_noise,
    share_left,
    strength_stds,
    surprise,
    typical_errors,
    verdict,
    violated_priors,
)
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import strengths_of
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import NoFitError
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.fit import FitResult, Method, estimate
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.prepare import DISCREPANCY
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import in_background
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


def conclude(case: Case, bench: Workbench, training: Problem, outcome: Outcome, begin: float) -> Diagnosis:
    """Put everything together. `begin`: `time.perf_counter()` at the start of the diagnosis."""
    declared = bench.bare(outcome.declared, [])
    begun = in_background(lambda: _begun(case, outcome))
    outcome, final, refused = _borne_out(case, bench, training, outcome)
    names = [candidate.name for candidate in outcome.found]
    values = _estimates(final, outcome.folds) if final else {}
    effects = tuple(_found(candidate, values) for candidate in outcome.found)
    missing = missing_rates(case, outcome.model)
    traces = _traces(case, outcome, begun.result())
    before, after = (errors(case, each, traces.held_out) for each in (traces.before, traces.after))
    squares = bench.least_mean_squares(outcome.model, training)
    left = unexplained(case, missing, squares, after)
    noise = {column: noise_of(case, column) for column in traces.measured}
    of_columns = {c: squares[out] for out, names in case.actuator.outputs.items() for c in names}
    windows = [training_squares(case, each) for each in (traces.before, traces.after)]
    may_miss = max(
        missing_in_noise(final, of_columns, noise, after["training"]), far_off(of_columns, windows[1])
    )
    remaining = share_left(*windows)
    said = verdict(
        found=bool(names),
        left=bool(left),
        missing=max(may_miss, surprise(after)),
        confirms=confirmed(before, after),
        imitates=may_miss > MISSING and remaining > IMITATED,
    )
    holds = said == "effects found"
    return Diagnosis(
        recording=case.recording,
        verdict=said,
        effects=effects if holds else (),
        unconfirmed=() if holds else effects,
        refused=refused,
        unused={column: int((~rows).sum()) for column, rows in case.usable.items() if not rows.all()},
        violated_priors=violated_priors(final, _believed(case, bench, names)),
        missing_in_noise=may_miss,
        share_left=remaining,
        typical_error=max(typical_errors(windows[1]).values(), default=0.0),
        rounds=outcome.rounds,
        declared=declared,
        model=final.actuator if final else bench.bare(outcome.model, names),
        fit=final,
        before=before,
        after=after,
        noise=noise,
        units={c: case.actuator.column(c).unit for c in case.recording.columns},
        horizon=case.recording.card.horizon,
        held_out_fraction=float(traces.held_out.mean()),
        unexplained=left,
        parameters=values,
        correlations=final.correlations if final else pd.DataFrame(),
        reveal=reveal(case, outcome.model, outcome.found[0].effects[0] if outcome.found else None, missing),
        traces=traces,
        converged=outcome.converged and (final is None or final.code in SETTLED),
        seconds=time.perf_counter() - begin,
        settings={
            "windows": len(case.windows),
            "held_out_windows": int(case.windows.held_out.sum()),
            "substeps": case.problem.substeps,
            "candidates": [effect.name for effect in bench.candidates],
            **({"constants": [each.quantity for each in bench.constants]} if bench.constants else {}),
            "random": "none: nothing is drawn at random",
        },
    )


def _borne_out(
    case: Case, bench: Workbench, training: Problem, outcome: Outcome
) -> tuple[Outcome, FitResult | None, dict[str, str]]:
    """The outcome with the values of the last fit, without effects that this fit does not bear out.

    An effect with which predictions from some window on are not numbers is none either: those that were
    added last are taken out until the others can be fitted.

    Returns:
        outcome, last fit, and name of each effect that was taken out again → why.
    """
    refused: dict[str, str] = {}
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
            return outcome, None, refused
        fitted = {entry.path: entry.value for entry in final.parameters.values()}
        outcome = dataclasses.replace(outcome, model=replace(outcome.model, fitted))
        strengths = {c.name: _strengths(c.effects[0]) for c in outcome.found}
        largest = {c.name: largest_strength(case, outcome.model, c.name) for c in outcome.found}
        found = [_found(c, _judging(c, final, outcome.folds)) for c in outcome.found]
        reasons = doubted(found, strengths, largest)
        if not reasons:
            return outcome, final, refused
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
    `blind_recordings.drawn`: share 0.049 +- 0.027, and +- 0.003 with the time constant held). Where unseen
    stretches speak for an effect, that folds disagree on how much is no doubt that it is there. A likelihood
    ratio takes the noise for what it seems to be; then it is a doubt.
    """
    std = strength_stds(final, candidate.name, _strengths(candidate.effects[0]))
    return _estimates(final, folds if candidate.evidence.test == LIKELIHOOD_RATIO else (), std)


def _without(bench: Workbench, training: Problem, outcome: Outcome, refused: Collection[str]) -> Outcome:
    """The outcome without some of its effects, everything else fitted again."""
    kept = tuple(candidate for candidate in outcome.found if candidate.name not in refused)
    gone = {p: v for c in outcome.found if c not in kept for p, v in without(c.effects[0]).items()}
    names = [candidate.name for candidate in kept]
    model = bench.dressed(replace(outcome.model, gone), names)
    fitted = bench.best_fit((model, bench.with_card_values(model)), names, training, FIT_STEPS)
    converged = outcome.converged and fitted.converged
    return dataclasses.replace(outcome, model=fitted.model, found=kept, folds=(), converged=converged)


def _believed(case: Case, bench: Workbench, names: list[str]) -> dict[str, Prior]:
    """What the card says, without the constants that were found to be wrong."""
    return {path: prior for path, prior in case.priors.items() if path not in bench.freed(names)}


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
    found = estimate(model, given, asked, unused, Method(noise=DISCREPANCY, program=program))
    lean = bench.bare(found.actuator, names)
    return dataclasses.replace(found, actuator=lean, actuators=(lean,))


def _estimates(
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


def _found(candidate: Candidate, values: dict[str, Estimate]) -> FoundEffect:
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


def _strengths(sought: Sought) -> tuple[str, ...]:
    """Names of what tells how much of a candidate there is."""
    return (sought.quantity,) if isinstance(sought, CardConstant) else strengths_of(sought)


def held_out_rows(case: Case) -> NDArray[np.bool_]:
    """Rows that no fit and no choice may see."""
    held_out, windows = np.zeros(len(case.recording), dtype=bool), case.windows
    for row, mask in zip(windows.rows[windows.held_out], windows.mask[windows.held_out], strict=True):
        held_out[row + np.flatnonzero(mask)] = True
    return held_out


def _begun(case: Case, outcome: Outcome) -> dict[str, NDArray[np.float64]]:
    """What the declared model predicts; what the found one leaves is computed to have it compiled."""
    missing_rates(case, outcome.model)
    return predicted_columns(case, outcome.declared)


def _traces(case: Case, outcome: Outcome, before: dict[str, NDArray[np.float64]]) -> Traces:
    after = predicted_columns(case, outcome.model)
    return Traces(
        time=case.recording.time,
        measured={name: case.recording.columns[name] for name in after},
        before=before if outcome.found else after,
        after=after,
        windows=case.windows.rows,
        held_out=held_out_rows(case),
    )
