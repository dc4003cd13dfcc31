"""Prediction errors, column by column."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.beginnings import begun
from jaxmuscle.diagnosis.result import Error
from jaxmuscle.fitting.case import Case
from jaxmuscle.fitting.predictions import chain_predictions

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
