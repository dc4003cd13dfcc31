"""From the fitted models to what is reported; the only place where held-out rows are looked at."""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.errors import errors, noise_of, predicted_columns
from jaxmuscle.diagnosis.rank import Candidate
from jaxmuscle.diagnosis.rates import missing_rates
from jaxmuscle.diagnosis.result import (
    Diagnosis,
    Estimate,
    FoundEffect,
    Round,
    Traces,
)
from jaxmuscle.diagnosis.reveal import reveal
from jaxmuscle.diagnosis.unexplained import unexplained
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.fit import fit_nearby
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.fitting.case import Case
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.parameter_names import of_effect
from jaxmuscle.parameters import get


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the search found: the two fitted models, what was added, the searches, fits to each fold.

    `ignored`: rows whose readings count for nothing; `None` for none.
    """

    declared: AbstractActuator
    model: AbstractActuator
    found: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    folds: tuple[AbstractActuator, ...]
    converged: bool
    ignored: NDArray[np.bool_] | None = None


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
    declared = _lean(bench, outcome.declared, [])
    final = _final_fit(case, bench, outcome, names)
    missing = missing_rates(case, outcome.model)
    traces = _traces(case, bench, outcome)
    after = errors(case, traces.after, traces.held_out)
    left = unexplained(case, missing, mean_squares(bench, outcome.model, training), after)
    verdict = "effects found" if names else "unexplained" if left else "complete"
    values = _estimates(final, outcome.folds)
    return Diagnosis(
        recording=case.recording,
        verdict=verdict,
        effects=tuple(_found(candidate, values) for candidate in outcome.found),
        rounds=outcome.rounds,
        declared=declared,
        model=final.actuator,
        fit=final,
        before=errors(case, traces.before, traces.held_out),
        after=after,
        noise={column: noise_of(case, column) for column in traces.measured},
        units={c: case.actuator.column(c).unit for c in case.recording.columns},
        horizon=case.recording.card.horizon,
        held_out_fraction=float(traces.held_out.mean()),
        unexplained=left,
        parameters=values,
        correlations=final.correlations,
        reveal=reveal(case, outcome.model, outcome.found[0].effect if outcome.found else None, missing),
        traces=traces,
        converged=outcome.converged and final.converged,
        seconds=time.perf_counter() - begin,
        settings={
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


def _final_fit(case: Case, bench: Workbench, outcome: Outcome, names: list[str]) -> FitResult:
    """The found model fitted to all rows, those that were held out for its errors included."""
    model = _lean(bench, outcome.model, names)
    free, priors = bench.free_paths(model, names), bench.shape_priors(model, names)
    known = {path: (prior.mean, prior.std) for path, prior in priors.items()}
    return fit_nearby(model, case.recording, free, known, outcome.ignored)


def _estimates(final: FitResult, folds: Sequence[AbstractActuator]) -> dict[str, Estimate]:
    """Values and standard deviations: those of the final fit, or by how much fits to the folds disagree.

    The delete-a-group jackknife over `folds`, models of the same effects each fitted without a part of the
    data (Kott, J. Official Statistics 17, 2001), allows for what the model lacks, as no covariance does.
    """
    found = {}
    for name, entry in final.parameters.items():
        spread = 0.0
        if len(folds) > 1:
            values = np.array([float(get(model, entry.path)) for model in folds])
            spread = float(np.sqrt((len(folds) - 1) * values.var()))
        found[name] = Estimate(entry.value, max(entry.std, spread), entry.unit, entry.meaning)
    return found


def _found(candidate: Candidate, values: dict[str, Estimate]) -> FoundEffect:
    effect = candidate.effect
    return FoundEffect(
        name=effect.name,
        signal=effect.slot.name,
        meaning=(inspect.getdoc(effect) or "").splitlines()[0],
        source=effect.source,
        parameters=of_effect(effect.name, values),
        gain=candidate.evidence.gain,
        p_value=candidate.evidence.p_value,
    )


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
