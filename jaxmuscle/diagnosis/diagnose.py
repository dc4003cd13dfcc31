"""Diagnosis (`jaxmuscle.diagnose`): fit, find the effect that unseen data support, add it, refit, repeat;
then conclude, the only place where held-out rows are looked at.
"""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle._config import require_double_precision
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import SETTLED, Workbench, missing, workbench
from jaxmuscle.diagnosis.dependence import reveal, unexplained
from jaxmuscle.diagnosis.discrepancy import missing_rates
from jaxmuscle.diagnosis.evidence import compare
from jaxmuscle.diagnosis.excitation import excited
from jaxmuscle.diagnosis.prediction_errors import errors, noise_of, predicted_columns
from jaxmuscle.diagnosis.ranking import (
    CONCLUSION,
    DECLARED,
    REFIT,
    Candidate,
    Ranking,
    fold_count,
    rank,
    round_work,
)
from jaxmuscle.diagnosis.result import Alternative, Diagnosis, Estimate, FoundEffect, Round, Traces
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.fit import FitResult, Method, estimate
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.weights import expected_spread
from jaxmuscle.estimation.windows import Case, Problem, case
from jaxmuscle.parallel import in_background
from jaxmuscle.parameter_names import of_effect
from jaxmuscle.parameters import get, replace
from jaxmuscle.progress import Meter, Progress, interruptible
from jaxmuscle.recordings.recording import Recording


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
    begun = in_background(lambda: _begun(case, outcome))
    final = _final_fit(case, bench, outcome, names)
    before = begun.result()
    if final:
        fitted = {entry.path: entry.value for entry in final.parameters.values()}
        outcome = dataclasses.replace(outcome, model=replace(outcome.model, fitted))
    missing = missing_rates(case, outcome.model)
    traces = _traces(case, outcome, before)
    after = errors(case, traces.after, traces.held_out)
    left = unexplained(case, missing, mean_squares(bench, outcome.model, training), after)
    verdict = "effects found" if names else "unexplained" if left else "complete"
    values = _estimates(final, outcome.folds) if final else {}
    return Diagnosis(
        recording=case.recording,
        verdict=verdict,
        effects=tuple(_found(candidate, values) for candidate in outcome.found),
        rounds=outcome.rounds,
        declared=declared,
        model=final.actuator if final else _lean(bench, outcome.model, names),
        fit=final,
        before=errors(case, traces.before, traces.held_out),
        after=after,
        noise={column: noise_of(case, column) for column in traces.measured},
        units={c: case.actuator.column(c).unit for c in case.recording.columns},
        horizon=case.recording.card.horizon,
        held_out_fraction=float(traces.held_out.mean()),
        unexplained=left,
        parameters=values,
        correlations=final.correlations if final else pd.DataFrame(),
        reveal=reveal(case, outcome.model, outcome.found[0].effect if outcome.found else None, missing),
        traces=traces,
        converged=outcome.converged and (final is None or final.code in SETTLED),
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


def _final_fit(case: Case, bench: Workbench, outcome: Outcome, names: list[str]) -> FitResult | None:
    """The found model fitted as by :func:`jaxmuscle.fit`, without the held-out rows; `None` if all is known.

    It carries the other candidates at zero strength, so that the programs of the search serve it.
    """
    model = bench.dressed(outcome.model, names)
    free, priors = bench.free_paths(model, names), bench.shape_priors(model, names)
    if not free:
        return None
    asked = Asked(free, priors=dict(priors))
    unused = held_out_rows(case) | (False if outcome.ignored is None else outcome.ignored)
    found = estimate(model, (case.recording,), asked, unused, Method(program=bench.program(model)))
    lean = _lean(bench, found.actuator, names)
    return dataclasses.replace(found, actuator=lean, actuators=(lean,))


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


MOST_EFFECTS = 3
LEAST_GAIN = 0.10
"""Part of the excess error on unseen windows that an effect must remove."""
LARGEST_P = 0.01
"""p-value up to which the first effect is added; half of that for the second, a quarter for the third."""
NOTHING_LEFT = 1.1
"""Typical mean square weighted residual (1 = noise) below which most windows miss nothing."""
MOST_OF_LITTLE = 0.5
"""Part of the excess error that an effect must remove where most windows miss nothing."""
TOLD_APART = 0.05
"""p-value below which the best candidate is told apart from another."""
FIT_STEPS = 60
PARTS = 4
"""Parts of a window that candidates are searched and judged on: starting anew keeps the cost smooth."""
SPREAD = 2.0
"""Standard deviations by which smoothed states are shifted to see what they leave uncertain."""


def _silent(progress: Progress) -> None:
    """Progress that goes nowhere."""


def diagnose(
    recording: Recording,
    *,
    held_out: float | NDArray[np.bool_] = 0.3,
    ignored: NDArray[np.bool_] | None = None,
    catalogue: Sequence[type[AbstractEffect]] = CATALOGUE,
    progress: Callable[[Progress], None] = _silent,
) -> Diagnosis:
    """Fit the model that a recording's card declares and find what it lacks.

    Every round fits the present model and the model with each candidate on some of the training windows
    and judges them on the others, fold by fold. The best candidate is added when it removes at least a
    tenth of the excess error on unseen windows with p < 0.01 (the second with p < 0.005, the third with
    p < 0.0025); everything is refitted; at most three effects are added. The held-out rows take no part in
    that: they give the errors that are reported, and tell whether something is unexplained that the training
    rows did not show.

    Args:
        recording: as :func:`jaxmuscle.read` gives it.
        held_out: fraction of the recording, at its end, kept for reporting; or a mask over its rows.
        ignored: rows whose readings count for nothing (a saturated sensor, a slack muscle).
        catalogue: effects to choose from.
        progress: called at each step with a :class:`~jaxmuscle.progress.Progress`, whose text is a line:
            `print` will do.

    Returns:
        a :class:`Diagnosis`; its verdict is "effects found", "complete" (nothing is missing) or
        "unexplained" (something is, and no effect of the catalogue explains it).
    """
    meter = Meter(progress)
    return interruptible(lambda: _diagnosed(recording, held_out, ignored, catalogue, meter), meter.stop)


def _diagnosed(
    recording: Recording,
    held_out: float | NDArray[np.bool_],
    ignored: NDArray[np.bool_] | None,
    catalogue: Sequence[type[AbstractEffect]],
    meter: Meter,
) -> Diagnosis:
    """Arguments as of :func:`diagnose`."""
    require_double_precision("a diagnosis")
    begin = time.perf_counter()
    prepared = case(recording, held_out, ignored)
    candidates = excited(prepared, prepared.actuator, missing(prepared.actuator, catalogue))
    bench = workbench(prepared, candidates)
    parts = prepared.training.in_parts(PARTS)
    meter.expect(DECLARED + round_work(candidates, fold_count(parts)) + CONCLUSION)
    meter.did(0.0, "fitting the declared model")
    compiled = in_background(lambda: bench.compile_stateful(parts))
    declared, _ = bench.fit(bench.model, [], parts, FIT_STEPS)
    meter.did(DECLARED, "fitting the declared model with its final weights")
    parts = _with_spread(prepared, parts, declared)
    declared, _ = bench.fit(declared, [], parts, FIT_STEPS)
    training = _with_spread(prepared, prepared.training, declared)
    declared, minimum = bench.fit(declared, [], training, FIT_STEPS)
    model, found, rounds, folds = declared, [], [], ()
    while len(found) < MOST_EFFECTS and len(found) < len(bench.candidates):
        if max(mean_squares(bench, model, training).values()) < NOTHING_LEFT:
            break
        compiled.result()
        ranking = rank(bench, model, [f.effect.name for f in found], parts, meter)
        best = _supported(ranking, len(found))
        rounds.append(_round(ranking, best))
        folds = best.folds if best else ranking.folds
        if best is None:
            break
        found.append(best)
        meter.expect(REFIT)
        meter.did(0.0, f"adding {best.effect.name}, refitting everything")
        names = [f.effect.name for f in found]
        begins = (best.model, bench.with_card_values(best.model))
        model, minimum = bench.best_fit(begins, names, training, FIT_STEPS)
        meter.did(REFIT, f"looking whether the model with {best.effect.name} lacks anything else")
    meter.skip_to(CONCLUSION, "predicting the held-out data")
    outcome = Outcome(declared, model, tuple(found), tuple(rounds), folds, minimum.code in SETTLED, ignored)
    return conclude(prepared, bench, training, outcome, begin)


def _with_spread(prepared: Case, training: Problem, model: AbstractActuator) -> Problem:
    """The training windows, with weights that allow for what the smoothed states leave uncertain."""
    wider = {name: SPREAD * values for name, values in prepared.observed.spread.items()}
    return training.allowing(expected_spread(model, training, wider))


def _supported(ranking: Ranking, found: int) -> Candidate | None:
    """The best candidate, if unseen windows support it; `found`: effects that were added before.

    Where only a few windows miss something, chance finds one among many candidates that helps there: it has
    to explain most of them, and its p-value counts the candidates. Every round is another chance to be
    misled: each may spend half of what the one before could, so that all of them together stay below twice
    :data:`LARGEST_P`.
    """
    if not ranking.candidates:
        return None
    best, little = ranking.candidates[0], ranking.loss < NOTHING_LEFT
    least = MOST_OF_LITTLE if little else LEAST_GAIN
    largest = LARGEST_P / 2**found / (len(ranking.candidates) if little else 1)
    supported = best.evidence.gain >= least and best.evidence.p_value <= largest
    return best if supported else None


def _told_apart(candidate: Candidate, best: Candidate) -> bool:
    """Whether `best` predicts unseen windows significantly better than another candidate."""
    return candidate is not best and compare(candidate.losses, best.losses).p_value < TOLD_APART


def _round(ranking: Ranking, best: Candidate | None) -> Round:
    first = ranking.candidates[0]
    entries = tuple(
        Alternative(
            candidate.effect.name,
            candidate.effect.slot.name,
            candidate.evidence.gain,
            candidate.evidence.p_value,
            candidate.evidence.loss,
            not candidate.judged or _told_apart(candidate, first),
            candidate.judged,
        )
        for candidate in ranking.candidates
    )
    return Round(ranking.loss, entries, best.effect.name if best else None)
