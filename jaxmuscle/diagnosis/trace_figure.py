"""Figure of a diagnosis: a measured column with what the models predict, its residual, a closer look."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from jaxmuscle.diagnosis.diagnosis_data import DiagnosisData, Series, Traces
from jaxmuscle.diagnosis.shown_column import ShownColumn, shown_column
from jaxmuscle.figure_style import AFTER, BEFORE, INK, MUTED, SHADE, STYLE, WIDTH, curve
from jaxmuscle.figure_style import figure as empty_figure
from jaxmuscle.formatting import capital, join, rounded, words

PIECES = 6
"""Parts of the held-out data among which the closer look chooses when there are no windows."""
WORTH_A_LOOK, VISIBLE = 0.95, 2.0
"""A closer look needs an error that fell below this part of what it was, from this many times the noise."""

NARROW = 0.05
"""Part of an axis below which the edges of the noise band would hide what lies in it."""


def trace_figure(diagnosis: DiagnosisData, column: str) -> Figure:
    """Column over time (top), its residual (middle) and the most telling held-out window (bottom)."""
    drawing = empty_figure(_height(diagnosis, column), WIDTH)
    _draw(drawing, diagnosis, column)
    return drawing


def diagnosis_figure(diagnosis: DiagnosisData, columns: Sequence[str]) -> Figure:
    """:func:`trace_figure` of several columns, one beneath the other, on white."""
    heights = [_height(diagnosis, column) for column in columns]
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = empty_figure(sum(heights), WIDTH)
        parts: Any = drawing.subfigures(len(columns), 1, height_ratios=heights, squeeze=False)
        for part, column in zip(parts[:, 0], columns, strict=True):
            _draw(part, diagnosis, column)
            part.suptitle(trace_caption(diagnosis, column), fontsize=10.5, x=0.01, ha="left")
    return drawing


def _height(diagnosis: DiagnosisData, column: str) -> float:
    return 6.9 if _worth_a_look(diagnosis, column) else 4.4


def _draw(drawing: Figure | SubFigure, diagnosis: DiagnosisData, column: str) -> None:
    shown, rows = shown_column(diagnosis, column), telling_rows(diagnosis, column)
    closer = _worth_a_look(diagnosis, column)
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


def residuals_of(diagnosis: DiagnosisData, column: str) -> list[tuple[str, str, Series]]:
    """(label, colour, predicted - measured) of the declared and, when anything was added, the final model."""
    traces = diagnosis.traces
    measured = traces.measured[column]
    return [
        (label, colour, predicted - measured) for label, colour, predicted in models_of(diagnosis, column)
    ]


def models_of(diagnosis: DiagnosisData, column: str) -> list[tuple[str, str, Series]]:
    """(label, colour, prediction) of the declared and, when anything was added, the final model."""
    traces = diagnosis.traces
    if not diagnosis.added:
        return [("model", AFTER, traces.after[column])]
    return [("before", BEFORE, traces.before[column]), ("after", AFTER, traces.after[column])]


def _overview(axes: Axes, diagnosis: DiagnosisData, shown: ShownColumn) -> None:
    traces = diagnosis.traces
    _shade(axes, traces, label=True)
    measured = shown.values(traces.measured[shown.name])
    curve(axes, traces.time, measured, color=INK, linewidth=2.0, label="measured")
    for label, colour, predicted in models_of(diagnosis, shown.name):
        values = shown.values(broken(predicted, traces))
        curve(axes, traces.time, values, color=colour, linewidth=1.1, label=label)
    axes.set_ylabel(f"{words(shown.name)} [{shown.unit}]")
    axes.margins(x=0.005)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handlelength=1.6)


def _residuals(axes: Axes, diagnosis: DiagnosisData, shown: ShownColumn) -> None:
    traces = diagnosis.traces
    _shade(axes, traces)
    band = 2 * diagnosis.noise[shown.name] / shown.size
    axes.axhspan(-band, band, color="#dbe4f0", linewidth=0, zorder=0.6)
    for _, colour, residual in residuals_of(diagnosis, shown.name):
        values = broken(residual, traces) / shown.size
        curve(axes, traces.time, values, color=colour, linewidth=0.9)
    if band > NARROW * np.ptp(axes.get_ylim()):
        for edge in (-band, band):
            axes.axhline(edge, color="#6f8fb8", linewidth=0.8, zorder=3)
    size = join(f"±{band:.2g}", shown.unit)
    axes.set_title(f"predicted minus measured; blue: ±2 σ of the sensor, {size}", color=MUTED, fontsize=9.5)
    axes.set_ylabel(f"error [{shown.unit}]")
    axes.margins(x=0.005)
    axes.set_xlabel("time [s]")


def _closer(axes: Axes, diagnosis: DiagnosisData, shown: ShownColumn, rows: NDArray[np.int64]) -> None:
    traces = diagnosis.traces
    time = traces.time[rows]
    curve(axes, time, shown.values(traces.measured[shown.name][rows]), color=INK, linewidth=2.8)
    for label, colour, predicted in models_of(diagnosis, shown.name):
        width = 1.8 if label == "before" else 1.4
        curve(axes, time, shown.values(broken(predicted, traces)[rows]), color=colour, linewidth=width)
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


def broken(predicted: Series, traces: Traces) -> Series:
    """A copy with a gap where a window ends: each window starts anew from what was measured."""
    values = np.array(predicted, dtype=float)
    values[traces.windows[traces.windows > 0] - 1] = np.nan
    return values


def _worth_a_look(diagnosis: DiagnosisData, column: str) -> bool:
    if diagnosis.added:
        return _improved(diagnosis, column)
    return diagnosis.after["held_out"][column].in_noise > VISIBLE


def _improved(diagnosis: DiagnosisData, column: str) -> bool:
    before, after = (part["held_out"][column] for part in (diagnosis.before, diagnosis.after))
    return before.in_noise > VISIBLE and after.rmse < WORTH_A_LOOK * before.rmse


def telling_rows(diagnosis: DiagnosisData, column: str) -> NDArray[np.int64]:
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


def trace_caption(diagnosis: DiagnosisData, column: str) -> str:
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
