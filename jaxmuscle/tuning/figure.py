"""Figure of a tuning: the worst scenarios before and after, with their commands, and all terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmuscle.figure_style import figure as empty_figure
from jaxmuscle.formatting import printed_unit
from jaxmuscle.tuning.scenario_costs import Judged

INK, BEFORE, AFTER = "#22272e", "#6b7280", "#d9531e"
COLOURS = {"reference": INK, "before": BEFORE, "after": AFTER}
STYLES = "-", "--", ":"
"""Lines of the readings of a robot's joints, one after the other."""


def plot(
    traces: Mapping[str, pd.DataFrame], units: Mapping[str, str], sides: Mapping[str, tuple[Judged, Judged]]
) -> Figure:
    """The figure; shown by a notebook, or saved with ``savefig``.

    A column for the worst training scenario and one for the worst that was held out: reference and reading
    above, commands below; beneath them every term after over before, on a logarithmic scale. Without traces
    that alone.
    """
    if not traces:
        figure = empty_figure(2.5, 5.5 * len(sides))
        alone: Any = figure.subplots(1, len(sides), squeeze=False)
        for axes, (name, both) in zip(alone[0], sides.items(), strict=True):
            axes.set_title(name, fontsize=9, loc="left")
            _terms(axes, units, *both)
        return figure
    figure = empty_figure(8.0, 5.5 * len(traces))
    axes: Any = figure.subplots(3, len(traces), squeeze=False, gridspec_kw={"height_ratios": [3, 2, 2]})
    for column, ((name, table), both) in enumerate(zip(traces.items(), sides.values(), strict=True)):
        _lines(axes[0, column], table, units.get("tracking", ""), command=False)
        _lines(axes[1, column], table, units.get("effort", ""), command=True)
        axes[0, column].set_title(name, fontsize=9, loc="left")
        _terms(axes[2, column], units, *both)
    return figure


def _lines(axes: Axes, table: pd.DataFrame, unit: str, command: bool) -> None:
    """Readings with their reference, or commands."""
    own = [name for name in table.columns if name.startswith("command") == command]
    values = table[own].to_numpy(dtype=float)
    size, printed = printed_unit(unit, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    labelled = set()
    for name in own:
        signal, *when = name.split()
        kind = when[0] if when else "reference"
        colour, width = COLOURS[kind], 1.0 if when else 1.4
        # Several commands are told apart by eye; one label for all of them leaves room for the curves.
        label = None if kind in labelled else kind
        labelled.add(kind)
        style = "-" if command else STYLES[_number(signal) % len(STYLES)]
        axes.plot(table.index, table[name] / size, style, color=colour, linewidth=width, label=label)
    axes.set_ylabel(f"{'command' if command else 'reading'} [{printed or '-'}]")
    axes.set_xlabel("time [s]")
    if not command:
        axes.legend(frameon=False, fontsize=8, loc="upper right", ncols=3, borderaxespad=0.1)
        axes.margins(y=0.14)


def _number(signal: str) -> int:
    """Which of several equal signals it is, from 0 on: 1 of "angle_2"."""
    last = signal.rpartition("_")[2]
    return int(last) - 1 if last.isdecimal() else 0


def _terms(axes: Axes, units: Mapping[str, str], before: Judged, after: Judged) -> None:
    """Every term after the tuning, relative to before."""
    names = [name for name in units if before.value(name) > 0 and after.value(name) > 0]
    ratios = {name: after.value(name) / before.value(name) for name in names}
    if before.cost > 0 and np.isfinite(before.cost + after.cost):
        ratios = {"cost": after.cost / before.cost, **ratios}
    axes.barh(list(ratios), np.array(list(ratios.values())) - 1, left=1.0, color=AFTER)
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set_xscale("log")
    axes.invert_yaxis()
    axes.set_xlabel("after over before")
