"""Figures of the report: measured and predicted columns, what reveals the missing effect, how the candidates
did, correlations of parameters.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jaxmuscle.diagnosis.result import Diagnosis, Reveal, Round, Series, Traces
from jaxmuscle.formatting import capital, join, parameter_words, percent, printed_unit, rounded, words
from jaxmuscle.report.style import AFTER, BEFORE, INK, MUTED, SHADE, WIDTH, curve, figure
from jaxmuscle.report.style import figure as empty_figure
from jaxmuscle.report.tables import ShownColumn, shown_column

PIECES = 6
"""Parts of the held-out data among which the closer look chooses when there are no windows."""
WORTH_A_LOOK, VISIBLE = 0.95, 2.0
"""A closer look needs an error that fell below this part of what it was, from this many times the noise."""

NARROW = 0.05
"""Part of an axis below which the edges of the noise band would hide what lies in it."""


def trace_figure(diagnosis: Diagnosis, column: str) -> Figure:
    """Column over time (top), its residual (middle) and the most telling held-out window (bottom)."""
    shown, rows = shown_column(diagnosis, column), _telling_rows(diagnosis, column)
    closer = _worth_a_look(diagnosis, column)
    drawing = empty_figure(6.9 if closer else 4.4, WIDTH)
    grid = drawing.add_gridspec(3 if closer else 2, 1, height_ratios=(1.25, 0.9, 1.35)[: 3 if closer else 2])
    top = drawing.add_subplot(grid[0])
    middle = drawing.add_subplot(grid[1], sharex=top)
    top.tick_params(labelbottom=False)
    _overview(top, diagnosis, shown)
    _residuals(middle, diagnosis, shown)
    if closer:
        bottom = drawing.add_subplot(grid[2])
        _closer(bottom, diagnosis, shown, rows)
        time = diagnosis.traces.time[rows]
        for axes in (top, middle):
            axes.axvspan(time[0], time[-1], fill=False, edgecolor=MUTED, linewidth=0.9, linestyle=(0, (3, 2)))
    drawing.align_ylabels()
    return drawing


def residuals_of(diagnosis: Diagnosis, column: str) -> list[tuple[str, str, Series]]:
    """(label, colour, predicted - measured) of the declared and, when anything was added, the final model."""
    traces = diagnosis.traces
    measured = traces.measured[column]
    return [(label, colour, predicted - measured) for label, colour, predicted in _models(diagnosis, column)]


def _models(diagnosis: Diagnosis, column: str) -> list[tuple[str, str, Series]]:
    traces = diagnosis.traces
    if not diagnosis.added:
        return [("model", AFTER, traces.after[column])]
    return [("before", BEFORE, traces.before[column]), ("after", AFTER, traces.after[column])]


def _overview(axes: Axes, diagnosis: Diagnosis, shown: ShownColumn) -> None:
    traces = diagnosis.traces
    _shade(axes, traces, label=True)
    measured = shown.values(traces.measured[shown.name])
    curve(axes, traces.time, measured, color=INK, linewidth=2.0, label="measured")
    for label, colour, predicted in _models(diagnosis, shown.name):
        values = shown.values(_broken(predicted, traces))
        curve(axes, traces.time, values, color=colour, linewidth=1.1, label=label)
    axes.set_ylabel(f"{words(shown.name)} [{shown.unit}]")
    axes.margins(x=0.005)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handlelength=1.6)


def _residuals(axes: Axes, diagnosis: Diagnosis, shown: ShownColumn) -> None:
    traces = diagnosis.traces
    _shade(axes, traces)
    band = 2 * diagnosis.noise[shown.name] / shown.size
    axes.axhspan(-band, band, color="#dbe4f0", linewidth=0, zorder=0.6)
    for _, colour, residual in residuals_of(diagnosis, shown.name):
        values = _broken(residual, traces) / shown.size
        curve(axes, traces.time, values, color=colour, linewidth=0.9)
    if band > NARROW * np.ptp(axes.get_ylim()):
        for edge in (-band, band):
            axes.axhline(edge, color="#6f8fb8", linewidth=0.8, zorder=3)
    size = join(f"±{band:.2g}", shown.unit)
    axes.set_title(f"predicted minus measured; blue: ±2 σ of the sensor, {size}", color=MUTED, fontsize=9.5)
    axes.set_ylabel(f"error [{shown.unit}]")
    axes.margins(x=0.005)
    axes.set_xlabel("time [s]")


def _closer(axes: Axes, diagnosis: Diagnosis, shown: ShownColumn, rows: NDArray[np.int64]) -> None:
    traces = diagnosis.traces
    time = traces.time[rows]
    curve(axes, time, shown.values(traces.measured[shown.name][rows]), color=INK, linewidth=2.8)
    for label, colour, predicted in _models(diagnosis, shown.name):
        width = 1.8 if label == "before" else 1.4
        curve(axes, time, shown.values(_broken(predicted, traces)[rows]), color=colour, linewidth=width)
    axes.set_facecolor(SHADE)
    axes.grid(color="white")
    title = "closer look: the most telling stretch of unseen data (dashed above)"
    axes.set_title(title, color=MUTED, fontsize=9.5)
    axes.set_ylabel(f"{words(shown.name)} [{shown.unit}]")
    axes.set_xlabel("time [s]")
    axes.margins(x=0.005)


def _shade(axes: Axes, traces: Traces, label: bool = False) -> None:
    rows = np.flatnonzero(traces.held_out)
    if len(rows) == 0:
        return
    start = end = 0.0
    for stretch in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        start, end = float(traces.time[stretch[0]]), float(traces.time[stretch[-1]])
        axes.axvspan(start, end, color=SHADE, linewidth=0, zorder=0.5)
    if label:
        look: dict[str, Any] = {"ha": "center", "color": MUTED, "fontsize": 9.5}
        axes.annotate("unseen data", (0.5 * (start + end), 1.03), xycoords=("data", "axes fraction"), **look)


def _broken(predicted: Series, traces: Traces) -> Series:
    """A copy with a gap where a window ends: each window starts anew from what was measured."""
    values = np.array(predicted, dtype=float)
    values[traces.windows[traces.windows > 0] - 1] = np.nan
    return values


def _worth_a_look(diagnosis: Diagnosis, column: str) -> bool:
    if diagnosis.added:
        return _improved(diagnosis, column)
    return diagnosis.after["held_out"][column].in_noise > VISIBLE


def _improved(diagnosis: Diagnosis, column: str) -> bool:
    before, after = (part["held_out"][column] for part in (diagnosis.before, diagnosis.after))
    return before.in_noise > VISIBLE and after.rmse < WORTH_A_LOOK * before.rmse


def _telling_rows(diagnosis: Diagnosis, column: str) -> NDArray[np.int64]:
    """The held-out window in which most was gained, or is left to gain when nothing was added."""
    traces = diagnosis.traces
    measured, held = traces.measured[column], np.flatnonzero(traces.held_out)
    after = (traces.after[column] - measured) ** 2
    score = (traces.before[column] - measured) ** 2 - after if diagnosis.added else after
    edges = np.append(traces.windows, len(measured))
    whole = [np.arange(start, end) for start, end in itertools.pairwise(edges)]
    windows = [rows for rows in whole if len(rows) > 1 and traces.held_out[rows].all()]
    pieces = windows if len(windows) > 1 else [rows for rows in np.array_split(held, PIECES) if len(rows) > 1]
    return max(pieces, key=lambda rows: np.nansum(score[rows]), default=np.arange(len(measured)))


def trace_caption(diagnosis: Diagnosis, column: str) -> str:
    """What to see in :func:`trace_figure`."""
    name, shown = capital(words(column)), shown_column(diagnosis, column)
    before, after = (part["held_out"][column] for part in (diagnosis.before, diagnosis.after))
    if not diagnosis.added:
        off = f"off by {shown.error(after.rmse)} on unseen data"
        return f"{name}: the model is {off}, {rounded(after.in_noise)} times the sensor noise."
    if _improved(diagnosis, column):
        change = f"falls from {shown.error(before.rmse)} (grey) to {shown.error(after.rmse)} (orange)"
        return f"{name}: the error on unseen data {change}, {rounded(after.in_noise)} times the sensor noise."
    pair = f"{shown.error(before.rmse)} before and {shown.error(after.rmse)} after"
    return f"{name}: what was added changes little here; off by {pair} on unseen data."


POINTS, BINS, SHOWN = 1500, 24, 8
"""Points of a scatter; bins of its median; candidates of a ranking that are drawn."""


def reveal_figure(reveal: Reveal) -> Figure:
    """What is missing against the variable that reveals it, without the effect and with it."""
    without, whole = (f"{word} {words(reveal.effect or '')}" for word in ("without", "with"))
    size_x, unit_x = printed_unit(reveal.variable_unit, float(np.nanpercentile(np.abs(reveal.x), 95)))
    size_y, unit_y = printed_unit(reveal.unit, float(np.nanstd(reveal.before)))
    drawing = figure(3.4)
    panels = np.atleast_1d(drawing.subplots(1, 2 if reveal.effect else 1, sharey=True, sharex=True))
    series = [(without, BEFORE, reveal.before), (whole, AFTER, reveal.after)][: len(panels)]
    for axes, (title, colour, values) in zip(panels, series, strict=True):
        axes.axhline(0, color="#c3c8d0", linewidth=1)
        _cloud(axes, reveal.x / size_x, values / size_y, colour)
        axes.set_xlabel(f"{words(reveal.variable)} [{unit_x}]" if unit_x else words(reveal.variable))
        if reveal.effect:
            axes.set_title(title, fontweight="bold", color=AFTER if title == whole else MUTED)
    # A few samples far out would leave no room for all others.
    panels[0].set_xlim(*_inner(reveal.x / size_x, 0.3))
    panels[0].set_ylim(*_inner(reveal.before / size_y, 3.0))
    panels[0].set_ylabel(f"missing in {words(reveal.signal)} [{unit_y}]")
    return drawing


def _inner(values: Series, percent: float) -> tuple[float | None, float | None]:
    """Limits of an axis without the outermost `percent` on either side; none where there is no extent."""
    low, high = (float(limit) for limit in np.nanpercentile(values, (percent, 100 - percent)))
    margin = 0.1 * (high - low)
    return (low - margin, high + margin) if margin > 0 else (None, None)


def _cloud(axes: Axes, x: Series, y: Series, colour: str) -> None:
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    x, y = x[finite], y[finite]
    some = np.random.default_rng(0).permutation(len(x))[:POINTS]
    axes.plot(x[some], y[some], ".", markersize=3, color=colour, alpha=0.35, markeredgewidth=0)
    # Bins of equal counts: as much data behind each dot of the median.
    bins = [rows for rows in np.array_split(np.argsort(x), BINS) if len(rows)]
    middle = [np.median(x[rows]) for rows in bins]
    median = [np.median(y[rows]) for rows in bins]
    axes.plot(middle, median, "o-", color=INK, linewidth=1.4, markersize=3.6)


def ranking_figure(search: Round) -> Figure:
    """The candidates of one search as bars: the part of the error on unseen windows that each removes."""
    best = search.ranking[:SHOWN]
    drawing = figure(0.62 + 0.34 * len(best))
    axes = drawing.add_subplot()
    places = np.arange(len(best))[::-1]
    for place, candidate in zip(places, best, strict=True):
        gain, added = max(candidate.gain, 0.0) * candidate.judged, candidate.name == search.added
        tied = search.added is not None and not added and not candidate.told_apart
        colour = AFTER if added else "#eeb79f" if tied else "#c9ced6"
        axes.barh(place, gain, height=0.62, color=colour)
        note = f"{percent(candidate.gain)}" if candidate.gain > 0 else "none: worse than without"
        note = note if candidate.judged else "not tried: explains too little where it is fitted"
        note += ", added" if added else ", not told apart from the best" if tied else ""
        axes.text(gain + 0.008, place, note, va="center", fontsize=9.5, color=INK if added or tied else MUTED)
    axes.set_yticks(places, [words(candidate.name) for candidate in best])
    axes.tick_params(axis="y", length=0, labelcolor=INK, labelsize=10)
    axes.set_xlim(0, 1.28)
    axes.set_xticks(np.arange(0, 1.01, 0.25), [f"{100 * tick:.0f} %" for tick in np.arange(0, 1.01, 0.25)])
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.spines["bottom"].set_bounds(0, 1)
    return drawing


def correlation_figure(correlations: pd.DataFrame) -> Figure:
    """The correlations between all fitted parameters as a coloured matrix."""
    names = [parameter_words(name) for name in map(str, correlations.columns)]
    count = len(names)
    drawing = figure(1.6 + 0.36 * count, min(3.4 + 0.62 * count, 9.2))
    axes = drawing.add_subplot()
    matrix = correlations.to_numpy(dtype=float)
    axes.imshow(matrix, cmap="PuOr", vmin=-1, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(matrix):
        if row != column and np.isfinite(value):
            shade = "white" if abs(value) > 0.75 else INK
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8.5, color=shade)
    axes.set_xticks(range(count), names, rotation=35, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(count), names)
    axes.grid(visible=False)
    axes.tick_params(length=0, labelcolor=INK)
    axes.spines[:].set_visible(False)
    return drawing


def strongest_correlation(diagnosis: Diagnosis) -> tuple[str, str, float] | None:
    """The two parameters that are correlated most, and by how much; `None` with fewer than two."""
    matrix = diagnosis.correlations.to_numpy(dtype=float).copy()
    if len(matrix) < 2:
        return None
    above = np.where(np.triu(np.ones_like(matrix), 1) > 0, np.abs(np.nan_to_num(matrix)), -1.0)
    row, column = np.unravel_index(np.argmax(above), above.shape)
    names = list(map(str, diagnosis.correlations.columns))
    return names[row], names[column], float(matrix[row, column])
