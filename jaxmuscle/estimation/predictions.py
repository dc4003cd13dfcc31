"""Predictions of the fitted models beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.covariance import Covariance
from jaxmuscle.estimation.intervals import QUANTILE, Noise
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import evaluate_chain, moved
from jaxmuscle.parameter_names import of_machine
from jaxmuscle.recordings.smoothing import noise_level


def predictions(
    objective: Objective,
    u: NDArray[np.float64],
    machines: Sequence[AbstractActuator],
    lines: Sequence[Series],
    sure: Covariance,
) -> dict[str, pd.DataFrame]:
    """Recording → table over time of every output's column: measured, fitted, its deviation, predicted.

    ``fitted`` comes from the links, each with its inputs as in the fit; ``predicted`` from the command alone,
    window by window. Both as the sensor shows it, its errors included. ``std`` is what a reading is expected
    to deviate from ``fitted`` by: the parameters' uncertainty, that of the states where windows begin, and
    the sensor's noise, or the size of the residuals (of 95 % of them) where that is larger.
    """
    found = {}
    for number, station in enumerate(objective.stations):
        recording = station.recording
        values, index = objective.unknowns.values(u), objective.unknowns.acting_on(number)
        beside = {
            objective.unknowns.entries[i].place.path: float(values[i])
            for i in index
            if not of_machine(objective.unknowns.entries[i].place.path)
        }
        shifts = [jnp.asarray(x) for x in beside.values()]
        chain = evaluate_chain(*moved(machines[number], station.problem, list(beside), shifts))
        layout = station.layout
        table: dict[str, NDArray[np.float64]] = {}
        for line in (line for line in lines if line.recording == number):
            weights = _column(layout, line, station.problem.weights)
            flat = _column(layout, line, chain)
            predicted, fitted, std = (np.full(len(recording), np.nan) for _ in range(3))
            inside = weights > 0
            predicted[layout.rows[inside]] = flat[inside]
            scale = np.full(len(recording), np.nan)
            scale[layout.rows[inside]] = weights[inside]
            measured = recording.columns[line.column]
            fitted[line.counts] = measured[line.counts] + line.deviation[line.counts] / scale[line.counts]
            std[line.counts] = _deviation(line, sure) / scale[line.counts]
            table |= {line.column: measured, f"{line.column} fitted": fitted, f"{line.column} std": std}
            table |= {f"{line.column} predicted": predicted}
        found[station.label] = pd.DataFrame(table, index=pd.Index(recording.time, name="time"))
    return found


def _deviation(line: Series, sure: Covariance) -> NDArray[np.float64]:
    """Standard deviation of the readings that count about the fitted values, in units of their weights.

    Its part from the readings is what 95 % of the residuals say, which outliers that a robust loss leaves
    aside do not widen.
    """
    # Along what the data leave open the predictions do not change.
    std = np.where(np.isfinite(sure.std), sure.std, 0.0)
    slopes = line.slopes[:, line.counts] * std[:, None]
    own = np.einsum("in,ij,jn->n", slopes, sure.correlations, slopes)
    residual = np.quantile(np.abs(line.residual[line.counts]), 0.95) / QUANTILE if line.counts.any() else 1.0
    return np.sqrt(np.maximum(own, 0.0) + max(1.0, float(residual)) ** 2)


def noise_table(
    objective: Objective, lines: Sequence[Series], sure: Covariance
) -> dict[str, dict[str, Noise]]:
    """Recording → column → the sensor's noise as assumed, and the residual's root mean square (SI)."""
    found: dict[str, dict[str, Noise]] = {}
    for line in lines:
        station = objective.stations[line.recording]
        weights = _column(station.layout, line, station.problem.weights)
        scale = np.ones(len(station.recording))
        scale[station.layout.rows[weights > 0]] = weights[weights > 0]
        in_si = (line.deviation / scale)[line.counts]
        # The weights allow for uncertain states; where these matter least they are the sensor's.
        largest = float(weights.max())
        found.setdefault(station.label, {})[line.column] = Noise(
            assumed=1 / largest if largest > 0 else noise_level(station.filled.columns[line.column]),
            residual=float(np.sqrt(np.mean(in_si**2))) if len(in_si) else float("nan"),
            ratio=_ratio(line.residual[line.counts], objective.loss),
            autocorrelation_time=sure.times[line.recording, line.column],
            unit=station.actuator.column(line.column).unit,
        )
    return found


def _ratio(residual: NDArray[np.float64], loss: Loss) -> float:
    """Size of the residuals, weighted as the loss does."""
    return float(np.sqrt(loss.mean_square(residual)))


def _column(layout: ResidualLayout, line: Series, values: Mapping[str, Any]) -> NDArray[np.float64]:
    """What `values` holds of the column of a series, window by window."""
    names = layout.columns[line.output]
    return layout.table(line.output, values[line.output])[..., names.index(line.column)]
