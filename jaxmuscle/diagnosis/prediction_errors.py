"""Prediction errors on held-out data, column by column, from initial velocities sharpened by the model."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.diagnosis_data import Error
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.residuals import evaluate_chain, freed
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.recordings.smoothing import WINDOWS

REACH = max(WINDOWS) // 2
"""Samples after the beginning that may speak: no more than smoothing has used."""
DOUBT = 5.0
"""Standard deviations of the smoothed velocity that it may be off: its bias where a motion starts."""
ROUNDS = 2

QUOTIENT = 1e-3
"""Standard deviations between the two starting rates of a difference quotient."""

Line = NDArray[np.float64]


def begun(case: Case, model: AbstractActuator) -> Problem:
    """The problem of `case` with the velocity at the beginning of every window as `model` and sensors agree.

    A smoothed velocity is off by several of its standard deviations where a motion starts abruptly, and a
    free mass carries that error on to the end of the window. The samples around the beginning say more to
    one who knows how the machine moves: one Gauss-Newton step per window, twice, on the first
    :data:`REACH` samples, with the smoothed velocity as a prior. Rigs whose velocity is imposed stay as
    they are, and so do windows that have to begin with what the past tells.
    """
    whole = freed(case.problem, model)
    if whole.track.start_errors:
        return whole
    rows = np.asarray(whole.rows)
    for name in model.derivatives:
        if name in model.imposed or np.ndim(whole.track.measured[name]) != 1:
            continue
        spread = np.asarray(case.observed.spread[name])[rows]
        # Where readings stand still to the last digit smoothing leaves no doubt: such a start stays.
        doubtful = spread > 0
        sure = (DOUBT * np.where(doubtful, spread, 1.0)) ** -2.0
        first = here = np.asarray(whole.track.measured[name])[rows]
        near = np.asarray(case.windows.mask) & (np.arange(case.windows.samples) < REACH)
        for _ in range(ROUNDS):
            step = _step(model, whole.only(near), name, here, first - here, sure)
            here = here + np.where(doubtful, step, 0.0)
            whole = _with_starts(whole, name, here)
    return whole


def _with_starts(problem: Problem, name: str, values: Line) -> Problem:
    track = problem.track
    series = np.array(track.measured[name])
    series[np.asarray(problem.rows)] = values
    return eqx.tree_at(lambda p: p.track.measured, problem, {**track.measured, name: jnp.asarray(series)})


def _step(model: AbstractActuator, problem: Problem, name: str, here: Line, back: Line, sure: Line) -> Line:
    """Gauss-Newton step of every window's starting rate `here`; `back` leads to its prior mean.

    Windows do not see each other's beginnings: one difference quotient serves all of them. It is that of
    predictions which are needed anyway, for which nothing else has to be compiled.
    """
    targets, weights = ({o: np.asarray(v) for o, v in t.items()} for t in (problem.targets, problem.weights))

    def residuals(starts: Line) -> dict[str, Line]:
        predicted = evaluate_chain(model, _with_starts(problem, name, starts))
        weighted = {o: (np.asarray(v) - targets[o]) * weights[o] for o, v in predicted.items()}
        return {o: values.reshape(len(here), -1) for o, values in weighted.items()}

    shift = QUOTIENT / np.sqrt(sure)
    value, moved = residuals(here), residuals(here + shift)
    slope = {o: (moved[o] - value[o]) / shift[:, None] for o in value}
    summed = lambda a, b: sum((a[o] * b[o]).sum(axis=1) for o in a)  # noqa: E731
    step = (sure * back - summed(value, slope)) / (sure + summed(slope, slope))
    return np.where(np.isfinite(step), step, 0.0)


def predicted_columns(case: Case, model: AbstractActuator) -> dict[str, Line]:
    """Predictions of every column from the command alone, window by window, on the recording's clock.

    Each window begins at the measured state, its velocity as :func:`begun` has it.
    """
    windows = case.windows
    found = {}
    inside = windows.sample_rows(len(case.recording))
    for output, values in evaluate_chain(model, begun(case, model)).items():
        table = np.asarray(values).reshape(*values.shape[:2], -1)
        for i, name in enumerate(model.outputs[output]):
            series = np.full(len(case.recording), np.nan)
            series[inside[windows.mask]] = table[..., i][windows.mask]
            found[name] = series
    return found


def errors(
    case: Case, predicted: dict[str, Line], held_out: NDArray[np.bool_]
) -> dict[str, dict[str, Error]]:
    """Errors on the training rows and on the held-out rows."""
    return {
        part: {name: _error(case, name, series, rows) for name, series in predicted.items()}
        for part, rows in (("training", ~held_out), ("held_out", held_out))
        if rows.any()
    }


def training_squares(case: Case, predicted: dict[str, Line]) -> dict[str, Float[np.ndarray, " windows"]]:
    """Column → mean square error of each training window, in units of its sensor's noise.

    Windows without a usable reading of a column are left out of it.
    """
    windows, found = case.windows, {}
    for name, series in predicted.items():
        error = ((series - case.filled.columns[name]) / noise_of(case, name)) ** 2
        there = np.isfinite(series) & case.usable[name]
        rows = windows.sample_rows(len(series))[~windows.held_out]
        inside = there[rows] & windows.mask[~windows.held_out]
        some = inside.any(axis=1)
        found[name] = np.where(inside, error[rows], 0.0).sum(axis=1)[some] / inside.sum(axis=1)[some]
    return found


def noise_of(case: Case, column: str) -> float:
    """Standard deviation of a column's sensor: the card's, or what the data show [SI]."""
    for output, names in case.actuator.outputs.items():
        if column in names:
            return float(np.atleast_1d(np.asarray(case.observed.noise[output]))[names.index(column)])
    raise KeyError(column)


def _error(case: Case, name: str, predicted: Line, rows: NDArray[np.bool_]) -> Error:
    rows = rows & np.isfinite(predicted) & case.usable[name]
    measured = case.recording.columns[name][rows]
    rmse = float(np.sqrt(np.mean((predicted[rows] - measured) ** 2)))
    spread = float(measured.std())
    unit = case.actuator.column(name).unit
    return Error(rmse, unit, rmse / spread if spread else 0.0, rmse / noise_of(case, name))
