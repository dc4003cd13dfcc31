"""From the fitted models to what is reported; the only place where held-out rows are looked at."""

from __future__ import annotations

import dataclasses
import inspect
import time

import numpy as np
import pandas as pd

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.errors import errors, noise_of, predicted_columns
from jaxmuscle.diagnosis.rank import Candidate, fold_count
from jaxmuscle.diagnosis.rates import MissingRate, missing_rates
from jaxmuscle.diagnosis.result import (
    Diagnosis,
    Error,
    Estimate,
    FoundEffect,
    Reveal,
    Round,
    Traces,
    Unexplained,
)
from jaxmuscle.diagnosis.uncertainty import estimates
from jaxmuscle.diagnosis.unknown import dependence, variables
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.fitting.case import Case
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.recordings.units import column_unit

SURPRISE = 3.0
"""Ratio of errors on unseen and on training data above which the training data did not tell all."""
UNEXPLAINED = 3.0
"""Root mean square weighted residual of a link (1 = noise) above which something is left unexplained."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the search found: the two fitted models, what was added, and the searches."""

    declared: AbstractActuator
    model: AbstractActuator
    found: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    converged: bool


def mean_squares(bench: Workbench, model: AbstractActuator, problem: Problem) -> dict[str, float]:
    """Mean square weighted residual of every output, 1 being what noise and smoothing leave."""
    found = {}
    for output, values in bench.residuals(model, problem).items():
        weighted = np.asarray(problem.weights[output]) > 0
        found[output] = float((values[weighted] ** 2).mean())
    return found


def conclude(case: Case, bench: Workbench, training: Problem, outcome: Outcome, begin: float) -> Diagnosis:
    """Put everything together. `begin`: `time.perf_counter()` at the start of the diagnosis."""
    names = [candidate.effect.name for candidate in outcome.found]
    values, correlations = estimates(bench, outcome.model, names, training)
    declared = _lean(bench, outcome.declared, [])
    model = _lean(bench, outcome.model, names)
    missing = missing_rates(case, model)
    traces = _traces(case, bench, outcome)
    after = errors(case, traces.after, traces.held_out)
    unexplained = _unexplained(case, missing, mean_squares(bench, outcome.model, training), after)
    verdict = "effects found" if names else "unexplained" if unexplained else "complete"
    rename = {path: _card_name(case.actuator, path) for path in values}
    return Diagnosis(
        recording=case.recording,
        verdict=verdict,
        effects=tuple(_found(candidate, values) for candidate in outcome.found),
        rounds=outcome.rounds,
        declared=declared,
        model=model,
        before=errors(case, traces.before, traces.held_out),
        after=after,
        noise={column: noise_of(case, column) for column in traces.measured},
        units={c: column_unit(c, case.actuator.units.get("command", "")) for c in case.recording.columns},
        horizon=case.recording.card.horizon,
        held_out_fraction=float(traces.held_out.mean()),
        unexplained=unexplained,
        parameters={rename[path]: estimate for path, estimate in values.items()},
        correlations=_renamed(correlations, rename),
        reveal=_reveal(case, missing_rates(case, declared), missing),
        traces=traces,
        converged=outcome.converged,
        seconds=time.perf_counter() - begin,
        settings={
            "folds": fold_count(len(training.rows)),
            "windows": len(case.windows),
            "held_out_windows": int(case.windows.held_out.sum()),
            "substeps": case.problem.substeps,
            "candidates": [effect.name for effect in bench.candidates],
            "random": "none: nothing is drawn at random",
        },
    )


def _lean(bench: Workbench, model: AbstractActuator, names: list[str]) -> AbstractActuator:
    """The model without the candidates that were not added."""
    return model.without_effects(*(e.name for e in bench.candidates if e.name not in names))


def _card_name(actuator: AbstractActuator, path: str) -> str:
    """The name of a quantity as cards have it; effects keep their path."""
    return next((name for name, place in actuator.quantities.items() if place == path), path)


def _renamed(correlations: pd.DataFrame, names: dict[str, str]) -> pd.DataFrame:
    return correlations.rename(index=names, columns=names)


def _found(candidate: Candidate, values: dict[str, Estimate]) -> FoundEffect:
    effect, prefix = candidate.effect, f"effects.{candidate.effect.name}."
    return FoundEffect(
        name=effect.name,
        signal=effect.slot.name,
        meaning=(inspect.getdoc(effect) or "").splitlines()[0],
        source=effect.source,
        parameters={p.removeprefix(prefix): v for p, v in values.items() if p.startswith(prefix)},
        gain=candidate.evidence.gain,
        p_value=candidate.evidence.p_value,
    )


def _unexplained(
    case: Case,
    missing: list[MissingRate],
    squares: dict[str, float],
    after: dict[str, dict[str, Error]],
) -> tuple[Unexplained, ...]:
    """Links whose residual the final model leaves large, on the training data or only on unseen data."""
    left = []
    for rate in missing:
        rms = float(np.sqrt(squares[rate.link.output]))
        for column in case.actuator.outputs[rate.link.output]:
            seen, unseen = (after[part][column].in_noise for part in ("training", "held_out"))
            if unseen > SURPRISE * max(seen, 1.0):
                rms = max(rms, unseen)
        if rms > UNEXPLAINED:
            found = dependence(rate, variables(case), case)
            left.append(Unexplained(rate.link.signal, found.share, found.variables, rms))
    return tuple(left)


def _traces(case: Case, bench: Workbench, outcome: Outcome) -> Traces:
    held_out = np.zeros(len(case.recording), dtype=bool)
    windows = case.windows
    for row, mask in zip(windows.rows[windows.held_out], windows.mask[windows.held_out], strict=True):
        held_out[row + np.flatnonzero(mask)] = True
    before = predicted_columns(case, outcome.declared)
    after = predicted_columns(case, outcome.model) if outcome.found else before
    return Traces(
        time=case.recording.time,
        measured={name: case.recording.columns[name] for name in before},
        before=before,
        after=after,
        windows=windows.rows,
        held_out=held_out,
    )


def _reveal(case: Case, before: list[MissingRate], after: list[MissingRate]) -> Reveal | None:
    """The link whose missing rate shrank most, against the variable on which it depended most."""
    named = variables(case)
    told = []
    for old, new in zip(before, after, strict=True):
        for column in old.values:
            weight = 1 / np.maximum(old.spread[column], 1e-300)
            fall = np.mean((old.values[column] * weight) ** 2) - np.mean((new.values[column] * weight) ** 2)
            told.append((float(fall), old, new, column))
    _, old, new, column = max(told, key=lambda entry: entry[0])
    found = dependence(dataclasses.replace(old, values={column: old.values[column]}), named, case)
    if not found.variables:
        return None
    variable = found.variables[0]
    base = case.actuator.derivatives.get(variable)
    source = case.actuator.measured[base][0] if base else variable
    unit = column_unit(source, case.actuator.units.get("command", ""))
    return Reveal(
        signal=old.link.signal,
        variable=variable,
        variable_unit=f"{unit}/s" if base else unit,
        unit=old.unit,
        x=named[variable],
        before=old.values[column],
        after=new.values[column],
    )
