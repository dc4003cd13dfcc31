"""Figures of the report: what reveals the missing effect, how the candidates did, correlations of
parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jaxmuscle.diagnosis.diagnosis_data import Reveal, Round, Series
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.effects.base import LOG_TIME, LOOP
from jaxmuscle.figure_style import AFTER, BEFORE, INK, MUTED, figure
from jaxmuscle.formatting import parameter_words, percent, printed_unit, words
from jaxmuscle.parameter_names import CONSTANT

POINTS, BINS, SHOWN = 1500, 24, 8
"""Points of a scatter; bins of its median; candidates of a ranking that are drawn."""
ACROSS, MOVING = 5, 0.1
"""Samples to either side that tell whether a variable rises; part of its fast changes that is none."""


def reveal_figure(reveal: Reveal) -> Figure:
    """What is missing against the variable that reveals it, without the effect and with it."""
    without, whole = titles(reveal.effect or "")
    size_x, unit_x = printed_unit(reveal.variable_unit, float(np.nanpercentile(np.abs(reveal.x), 95)))
    size_y, unit_y = printed_unit(reveal.unit, float(np.nanstd(reveal.before)))
    drawing = figure(3.4)
    panels = np.atleast_1d(drawing.subplots(1, 2 if reveal.effect else 1, sharey=True, sharex=True))
    series = [(without, BEFORE, reveal.before), (whole, AFTER, reveal.after)][: len(panels)]
    for axes, (title, colour, values) in zip(panels, series, strict=True):
        axes.axhline(0, color="#c3c8d0", linewidth=1)
        x, y = reveal.x / size_x, values / size_y
        if reveal.view == LOOP:
            _loop(axes, x, y, colour)
        elif reveal.view == LOG_TIME:
            axes.set_xscale("log")
            _cloud(axes, x, y, colour, equal_widths=True)
        else:
            _cloud(axes, x, y, colour)
        axes.set_xlabel(f"{words(reveal.variable)} [{unit_x}]" if unit_x else words(reveal.variable))
        if reveal.effect:
            axes.set_title(title, fontweight="bold", color=AFTER if title == whole else MUTED)
    # A few samples far out would leave no room for all others.
    if reveal.view != LOG_TIME:
        panels[0].set_xlim(*_inner(reveal.x / size_x, 0.3))
    panels[0].set_ylim(*_inner(reveal.before / size_y, 3.0))
    change = "change of what is missing" if reveal.view == LOG_TIME else "missing"
    panels[0].set_ylabel(f"{change} in {words(reveal.signal)} [{unit_y}]")
    return drawing


def titles(effect: str) -> tuple[str, str]:
    """What the models without an effect and with it are called; with a constant, by whose value they have."""
    if effect.startswith(CONSTANT):
        own = words(effect.removeprefix(CONSTANT))
        return f"{own} of the card", f"{own} as found"
    return f"without {words(effect)}", f"with {words(effect)}"


def _inner(values: Series, percent: float) -> tuple[float | None, float | None]:
    """Limits of an axis without the outermost `percent` on either side; none where there is no extent."""
    low, high = (float(limit) for limit in np.nanpercentile(values, (percent, 100 - percent)))
    margin = 0.1 * (high - low)
    return (low - margin, high + margin) if margin > 0 else (None, None)


def _cloud(axes: Axes, x: Series, y: Series, colour: str, *, equal_widths: bool = False) -> None:
    """Samples, and the median of bins: of equal counts, or of equal widths on a logarithmic axis."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    x, y = x[finite], y[finite]
    _points(axes, x, y, colour)
    if equal_widths:
        edges = np.geomspace(x.min(), x.max() * (1 + 1e-9), BINS + 1)
        bins = [np.flatnonzero((x >= low) & (x < high)) for low, high in itertools.pairwise(edges)]
    else:
        # As much data behind each dot of the median.
        bins = np.array_split(np.argsort(x), BINS)
    _medians(axes, x, y, bins, "o-", INK)


def _points(axes: Axes, x: Series, y: Series, colour: str) -> None:
    some = np.random.default_rng(0).permutation(len(x))[:POINTS]
    axes.plot(x[some], y[some], ".", markersize=3, color=colour, alpha=0.35, markeredgewidth=0)


def _medians(
    axes: Axes,
    x: Series,
    y: Series,
    bins: Sequence[NDArray[np.int64]],
    marks: str,
    colour: str,
    label: str = "",
) -> None:
    filled = [rows for rows in bins if len(rows)]
    middle = [np.median(x[rows]) for rows in filled]
    median = [np.median(y[rows]) for rows in filled]
    axes.plot(middle, median, marks, color=colour, linewidth=1.4, markersize=3.6, label=label or None)


def _loop(axes: Axes, x: Series, y: Series, colour: str) -> None:
    """Samples, and the medians while x rises and while it falls: apart where there is a loop."""
    ways = directions(x)
    finite = np.isfinite(x) & np.isfinite(y)
    _points(axes, x[finite], y[finite], colour)
    for way, marks, looks, label in ((1, ">-", INK, "rising"), (-1, "<-", "#3b6ea5", "falling")):
        rows = np.flatnonzero(finite & (ways == way))
        if len(rows):
            order = np.array_split(rows[np.argsort(x[rows])], BINS)
            _medians(axes, x, y, order, marks, looks, label)
    axes.legend(loc="best", title=None)


def directions(x: Series) -> NDArray[np.int64]:
    """1 where x rises, -1 where it falls, 0 where it hardly moves, by differences across some samples."""
    change = np.zeros_like(x)
    change[ACROSS:-ACROSS] = x[2 * ACROSS :] - x[: -2 * ACROSS]
    change = np.nan_to_num(change)
    fast = float(np.quantile(np.abs(change), 0.95))
    return np.where(np.abs(change) > MOVING * fast, np.sign(change), 0).astype(np.int64)


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
        note = note if candidate.judged else "not judged: explains too little where it is fitted"
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
    """The correlations between all fitted parameters as a coloured matrix, its diagonal left blank."""
    names = [parameter_words(name) for name in map(str, correlations.columns)]
    count = len(names)
    drawing = figure(1.6 + 0.36 * count, min(3.4 + 0.62 * count, 9.2))
    axes = drawing.add_subplot()
    matrix = np.where(np.eye(count) > 0, np.nan, correlations.to_numpy(dtype=float))
    axes.imshow(matrix, cmap="PuOr", vmin=-1, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            shade = "white" if abs(value) > 0.75 else INK
            shown = f"{round(value, 2) + 0.0:.2f}".replace("-", "−")  # No sign before 0.00.
            axes.text(column, row, shown, ha="center", va="center", fontsize=8.5, color=shade)
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
