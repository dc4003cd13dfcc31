"""Figure of a fit: measured and fitted, residuals, their autocorrelation, profiles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jaxmuscle.estimation.fit_data import FitData
from jaxmuscle.estimation.fit_files import number_of
from jaxmuscle.estimation.intervals import QUANTILE, Profile
from jaxmuscle.estimation.residual_analysis import ResidualTest
from jaxmuscle.figure_style import figure as empty_figure
from jaxmuscle.formatting import printed_unit

Values = NDArray[np.float64]

INK, FIT, MUTED = "#22272e", "#d9531e", "#6b7280"
MARGIN = 0.08
"""Space above and below the readings, as part of their range."""
ACROSS = 3
"""Profiles beside each other."""


def plot(result: FitData, recording: str | int = 0) -> Figure:
    """The figure of one recording; shown by a notebook, or saved with ``savefig``.

    A row for each column: measured and fitted over time with its 95 % band, the residual below it, and
    beside them the residual's autocorrelation and its correlation with the input that it follows most, both
    with their 99 % band; then the profiles with their 95 % level.
    """
    label = list(result.cards)[number_of(result, recording)]
    table = result.predictions[label]
    columns = [name for name in table.columns if not name.endswith((" fitted", " std", " predicted"))]
    rows, curves = len(columns), list(result.profiles)
    below = math.ceil(len(curves) / ACROSS)
    figure = empty_figure(3.4 * rows + 2.4 * below, 10.0)
    parts: Any = figure.subfigures(2, 1, height_ratios=[3.4 * rows, 2.4 * below]) if below else [figure]
    upper = parts[0]
    axes = upper.subplots(
        2 * rows, 2, squeeze=False, gridspec_kw={"width_ratios": [3, 1], "height_ratios": [2, 1] * rows}
    )
    for i, column in enumerate(columns):
        _column(axes[2 * i, 0], axes[2 * i + 1, 0], result, label, column)
        own = [test for test in result.tests if (test.recording, test.column) == (label, column)]
        inputs = [test for test in own if test.against != "itself"]
        most = max(inputs, key=lambda test: float(np.abs(test.correlation / test.band).max()), default=None)
        itself = next((test for test in own if test.against == "itself"), None)
        _correlation(axes[2 * i, 1], itself, "autocorrelation of the residual")
        _correlation(axes[2 * i + 1, 1], most, f"with {most.against}" if most else "")
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
    pair = table[[column, f"{column} fitted"]].to_numpy().T
    (measured, fitted), size = _sized(above, column, pair, noise.unit)
    above.plot(time, measured, color=INK, linewidth=1.4, label="measured")
    above.plot(time, fitted, color=FIT, linewidth=1.0, label="fitted")
    reach = QUANTILE * table[f"{column} std"].to_numpy() / size
    above.fill_between(time, fitted - reach, fitted + reach, color=FIT, alpha=0.2, linewidth=0, label="95 %")
    # The band may be far wider than the readings range where a fast motion is hardly known.
    inside = np.array([measured, fitted])[np.isfinite([measured, fitted])]
    if inside.size and np.ptp(inside) > 0:
        margin = MARGIN * np.ptp(inside)
        above.set_ylim(inside.min() - margin, inside.max() + margin)
    above.legend(frameon=False, fontsize=8, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    residual, size = _sized(beneath, "residual", pair[1] - pair[0], noise.unit)
    beneath.plot(time, residual, color=FIT, linewidth=0.7)
    beneath.axhspan(-2 * noise.assumed / size, 2 * noise.assumed / size, color="#e8ebef", zorder=0)
    beneath.set_xlabel("time [s]; grey: ± 2 standard deviations of the sensor")
    beneath.sharex(above)


def _sized(axes: Axes, name: str, values: Values, unit: str) -> tuple[Values, float]:
    """Values in a unit of the right size, which the axis names, and that size."""
    size, printed = printed_unit(unit, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    axes.set_ylabel(f"{name} [{printed or '-'}]")
    return values / size, size


def _correlation(axes: Axes, test: ResidualTest | None, title: str) -> None:
    if test is None:
        axes.set_axis_off()
        return
    axes.vlines(test.lags, 0, test.correlation, color=INK, linewidth=1.2)
    axes.fill_between(test.lags, -test.band, test.band, color="#e8ebef", zorder=0)
    axes.set_title(title, fontsize=9, loc="left")
    axes.set_xlabel("lag [samples]; grey: 99 %")


def _profile(axes: Axes, result: FitData, curve: Profile) -> None:
    fitted = result.parameters[curve.name]
    size, unit = printed_unit(fitted.unit, fitted.value)
    axes.plot(curve.values / size, curve.deviance, "o", color=FIT, markersize=3, label="profile")
    x = np.linspace(curve.values[0], curve.values[-1], 60)
    axes.plot(x / size, np.interp(x, curve.values, curve.roots) ** 2, "-", color=FIT, linewidth=1.2)
    if fitted.std > 0:
        parabola = ((x - fitted.value) / fitted.std) ** 2
        axes.plot(x / size, parabola, "--", color=MUTED, linewidth=0.9, label="parabola of the covariance")
    axes.axhline(QUANTILE**2, color=MUTED, linewidth=0.7)
    axes.set_title(curve.name, fontsize=8, loc="left")
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(f"[{unit or '-'}]")
    axes.set_ylabel("deviance")
    axes.legend(frameon=False, fontsize=7)
