"""A fit in one figure: measured and fitted, residuals, their autocorrelation, profiles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmuscle.estimation.cards import number_of
from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.profile import QUANTILE, Profile

INK, FIT, MUTED = "#22272e", "#d9531e", "#6b7280"
ACROSS = 3
"""Profiles beside each other."""


def plot(result: FitData, recording: str | int = 0) -> Figure:
    """The figure of one recording; shown by a notebook, or saved with ``savefig``.

    A row for each column: measured and fitted over time with its 95 % band, the residual below it, and
    beside them the
    residual's autocorrelation with its 99 % band; then the profiles with their 95 % level.
    """
    label = list(result.cards)[number_of(result, recording)]
    table = result.predictions[label]
    columns = [name for name in table.columns if not name.endswith((" fitted", " std", " predicted"))]
    rows, curves = len(columns), list(result.profiles)
    below = math.ceil(len(curves) / ACROSS)
    figure = Figure(figsize=(10.0, 3.4 * rows + 2.4 * below), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[3.4 * rows, 2.4 * below]) if below else [figure]
    upper = parts[0]
    axes = upper.subplots(
        2 * rows, 2, squeeze=False, gridspec_kw={"width_ratios": [3, 1], "height_ratios": [2, 1] * rows}
    )
    for i, column in enumerate(columns):
        _column(axes[2 * i, 0], axes[2 * i + 1, 0], result, label, column)
        axes[2 * i + 1, 1].set_axis_off()
        _autocorrelation(axes[2 * i, 1], result, label, column)
    upper.suptitle(label, fontsize=11)
    if below:
        grid = parts[1].subplots(below, ACROSS, squeeze=False).ravel()
        for place, curve in zip(grid, curves, strict=False):
            _profile(place, result, curve)
        for place in grid[len(curves) :]:
            place.set_axis_off()
    return figure


def _column(above: Axes, beneath: Axes, result: FitData, label: str, column: str) -> None:
    table, noise = result.predictions[label], result.noise[label][column]
    time = table.index.to_numpy(dtype=float)
    measured, fitted = table[column].to_numpy(), table[f"{column} fitted"].to_numpy()
    above.plot(time, measured, color=INK, linewidth=1.4, label="measured")
    above.plot(time, fitted, color=FIT, linewidth=1.0, label="fitted")
    reach = QUANTILE * table[f"{column} std"].to_numpy()
    above.fill_between(time, fitted - reach, fitted + reach, color=FIT, alpha=0.2, linewidth=0, label="95 %")
    above.set_ylabel(f"{column} [{noise.unit or '-'}]")
    above.legend(frameon=False, fontsize=8)
    beneath.plot(time, fitted - measured, color=FIT, linewidth=0.7)
    beneath.axhspan(-2 * noise.assumed, 2 * noise.assumed, color="#e8ebef", zorder=0)
    beneath.set_ylabel("residual")
    beneath.set_xlabel("time [s]; grey: ± 2 standard deviations of the sensor")
    beneath.sharex(above)


def _autocorrelation(axes: Axes, result: FitData, label: str, column: str) -> None:
    own = (t for t in result.tests if (t.recording, t.column, t.against) == (label, column, "itself"))
    found = next(own, None)
    if found is None:
        axes.set_axis_off()
        return
    axes.vlines(found.lags, 0, found.correlation, color=INK, linewidth=1.2)
    axes.fill_between(found.lags, -found.band, found.band, color="#e8ebef", zorder=0)
    axes.set_title("autocorrelation of the residual", fontsize=9, loc="left")
    axes.set_xlabel("lag [samples]; grey: 99 %")


def _profile(axes: Axes, result: FitData, curve: Profile) -> None:
    fitted = result.parameters[curve.name]
    axes.plot(curve.values, curve.deviance, "o", color=FIT, markersize=3, label="profile")
    x = np.linspace(curve.values[0], curve.values[-1], 60)
    axes.plot(x, np.interp(x, curve.values, curve.roots) ** 2, "-", color=FIT, linewidth=1.2)
    if fitted.std > 0:
        parabola = ((x - fitted.value) / fitted.std) ** 2
        axes.plot(x, parabola, "--", color=MUTED, linewidth=0.9, label="parabola of the covariance")
    axes.axhline(QUANTILE**2, color=MUTED, linewidth=0.7)
    axes.set_title(curve.name, fontsize=8, loc="left")
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(f"[{fitted.unit or '-'}]")
    axes.set_ylabel("deviance")
    axes.legend(frameon=False, fontsize=7)
