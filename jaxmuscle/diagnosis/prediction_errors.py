"""Prediction errors on held-out data, column by column, from initial velocities sharpened by the model."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.result import Error
from jaxmuscle.estimation.residuals import chain_predictions
from jaxmuscle.estimation.windows import Case, Problem, Residuals
from jaxmuscle.recordings.smoothing import WINDOWS

REACH = max(WINDOWS) // 2
"""Samples after the beginning that may speak: no more than smoothing has used."""
DOUBT = 5.0
"""Standard deviations of the smoothed velocity that it may be off: its bias where a motion starts."""
ROUNDS = 2

Starts = Float[Array, " windows"]


def begun(case: Case, model: AbstractActuator) -> Problem:
    """The problem of `case` with the velocity at the beginning of every window as `model` and sensors agree.

    A smoothed velocity is off by several of its standard deviations where a motion starts abruptly, and a
    free mass carries that error on to the end of the window. The samples around the beginning say more to
    one who knows how the machine moves: one Gauss-Newton step per window, twice, on the first
    :data:`REACH` samples, with the smoothed velocity as a prior. Rigs whose velocity is imposed stay as
    they are.
    """
    whole = case.problem
    for name in model.derivatives:
        if name in model.imposed or np.ndim(case.observed.track.measured[name]) != 1:
            continue
        rows = jnp.asarray(case.windows.rows)
        sure = (DOUBT * case.observed.spread[name][rows]) ** -2.0
        first = whole.track.measured[name][rows]
        near = np.asarray(case.windows.mask) & (np.arange(case.windows.samples) < REACH)
        judged = whole.only(near)
        for _ in range(ROUNDS):
            here = whole.track.measured[name][rows]
            step = _step(model, judged, name, first - here, sure)
            whole = _with_starts(whole, name, here + step)
            judged = eqx.tree_at(lambda p: p.track, judged, whole.track)
    return whole


def _with_starts(problem: Problem, name: str, values: Starts) -> Problem:
    track = problem.track
    series = track.measured[name].at[problem.rows].set(values)
    return eqx.tree_at(lambda p: p.track.measured, problem, {**track.measured, name: series})


@eqx.filter_jit
def _step(model: AbstractActuator, problem: Problem, name: str, back: Starts, sure: Starts) -> Starts:
    """Gauss-Newton step of every window's starting rate; `back` leads to its prior mean."""
    here = problem.track.measured[name][problem.rows]

    def residuals(starts: Starts) -> Residuals:
        predicted = chain_predictions(model, _with_starts(problem, name, starts))
        return {o: (predicted[o] - problem.targets[o]) * problem.weights[o] for o in predicted}

    # Windows do not see each other's beginnings: one tangent for all of them.
    value, slope = jax.jvp(residuals, (here,), (jnp.ones_like(here),))
    summed = lambda a, b: sum(_by_window(a[o] * b[o]) for o in a)  # noqa: E731
    step = (sure * back - summed(value, slope)) / (sure + summed(slope, slope))
    return jnp.where(jnp.isfinite(step), step, 0.0)


def _by_window(values: Array) -> Starts:
    return values.reshape(len(values), -1).sum(axis=1)


Series = NDArray[np.float64]

_chain_predictions = eqx.filter_jit(chain_predictions)


def predicted_columns(case: Case, model: AbstractActuator) -> dict[str, Series]:
    """Predictions of every column from the command alone, window by window, on the recording's clock.

    Each window begins at the measured state, its velocity as :func:`begun` has it.
    """
    windows = case.windows
    found = {}
    inside = windows.sample_rows(len(case.recording))
    for output, values in _chain_predictions(model, begun(case, model)).items():
        table = np.asarray(values).reshape(*values.shape[:2], -1)
        for i, name in enumerate(model.outputs[output]):
            series = np.full(len(case.recording), np.nan)
            series[inside[windows.mask]] = table[..., i][windows.mask]
            found[name] = series
    return found


def errors(
    case: Case, predicted: dict[str, Series], held_out: NDArray[np.bool_]
) -> dict[str, dict[str, Error]]:
    """Errors on the training rows and on the held-out rows."""
    return {
        part: {name: _error(case, name, series, rows) for name, series in predicted.items()}
        for part, rows in (("training", ~held_out), ("held_out", held_out))
        if rows.any()
    }


def noise_of(case: Case, column: str) -> float:
    """Standard deviation of a column's sensor: the card's, or what the data show [SI]."""
    for output, names in case.actuator.outputs.items():
        if column in names:
            return float(np.atleast_1d(np.asarray(case.observed.noise[output]))[names.index(column)])
    raise KeyError(column)


def _error(case: Case, name: str, predicted: Series, rows: NDArray[np.bool_]) -> Error:
    rows = rows & np.isfinite(predicted)
    measured = case.recording.columns[name][rows]
    rmse = float(np.sqrt(np.mean((predicted[rows] - measured) ** 2)))
    spread = float(measured.std())
    unit = case.actuator.column(name).unit
    return Error(rmse, unit, rmse / spread if spread else 0.0, rmse / noise_of(case, name))
