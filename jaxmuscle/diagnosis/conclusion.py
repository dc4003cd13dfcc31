"""Conclusion of a diagnosis: held-out errors and the verdict.

The only place where held-out rows are looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.diagnosis.dependence import unexplained
from jaxmuscle.diagnosis.diagnosis_data import Traces
from jaxmuscle.diagnosis.discrepancy import missing_rates, rate_slopes
from jaxmuscle.diagnosis.last_fit import BorneOut, Outcome, estimates, found_effect, held_out_rows
from jaxmuscle.diagnosis.partial_residual import reveal
from jaxmuscle.diagnosis.prediction_errors import errors, noise_of, predicted_columns, training_squares
from jaxmuscle.diagnosis.residual_pattern import left_by
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.diagnosis.settled_fit import SETTLED
from jaxmuscle.diagnosis.verdict import (
    IMITATED,
    MISSING,
    confirmed,
    far_off,
    missing_in_noise,
    share_left,
    surprise,
    typical_errors,
    verdict,
    violated_priors,
)
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.estimation.windows import Problem


def conclude(
    case: Case,
    bench: Workbench,
    training: Problem,
    last: BorneOut,
    begun: Callable[[], dict[str, NDArray[np.float64]]],
    begin: float,
) -> Diagnosis:
    """Put everything together, with the held-out rows.

    Args:
        begun: waits for what :func:`predicted_as_declared` gives.
        begin: `time.perf_counter()` at the start of the diagnosis.
    """
    outcome, final = last.outcome, last.fit
    declared = bench.bare(outcome.declared, [])
    names = [candidate.name for candidate in outcome.found]
    values = estimates(final, outcome.folds) if final else {}
    effects = tuple(found_effect(candidate, values) for candidate in outcome.found)
    missing = missing_rates(case, outcome.model)
    traces = _traces(case, outcome, begun())
    before, after = (errors(case, each, traces.held_out) for each in (traces.before, traces.after))
    squares = bench.least_mean_squares(outcome.model, training)
    residuals = bench.residuals(outcome.model, training)
    residual_of = partial(left_by, outcome.model, residuals, training)
    free = bench.unknowns(outcome.model, bench.free_paths(outcome.model, names), names)
    slopes = cache(partial(rate_slopes, case, outcome.model, free))
    left = unexplained(case, missing, slopes, squares, after, residual_of)
    first = outcome.found[0].effects[0] if outcome.found else None
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
        refused=dict(last.refused),
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
        reveal=reveal(case, outcome.model, first, missing, left),
        traces=traces,
        converged=outcome.converged and (final is None or final.code in SETTLED),
        seconds=time.perf_counter() - begin,
        settings={
            "windows": len(case.windows),
            "held_out_windows": int(case.windows.held_out.sum()),
            "substeps": case.problem.substeps,
            "loss": type(bench.loss).__name__.lower(),
            "candidates": [effect.name for effect in bench.candidates],
            **({"constants": [each.quantity for each in bench.constants]} if bench.constants else {}),
            "random": "none: nothing is drawn at random",
        },
    )


def _believed(case: Case, bench: Workbench, names: list[str]) -> dict[str, Prior]:
    """What the card says, without the constants that were found to be wrong."""
    return {path: prior for path, prior in case.priors.items() if path not in bench.freed(names)}


def predicted_as_declared(case: Case, outcome: Outcome) -> dict[str, NDArray[np.float64]]:
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
