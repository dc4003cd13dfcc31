"""Figure of a tuning: the worst scenarios before and after, with their commands, and all terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmuscle.formatting import printed_unit
from jaxmuscle.tuning.judged import Judged

INK, BEFORE, AFTER = "#22272e", "#6b7280", "#d9531e"


def plot(
    traces: Mapping[str, pd.DataFrame], units: Mapping[str, str], sides: Mapping[str, tuple[Judged, Judged]]
) -> Figure:
    """The figure; shown by a notebook, or saved with ``savefig``.

    A column for the worst training scenario and one for the worst that was held out: reference and reading
    above, commands below; beneath them every term after over before, on a logarithmic scale.
    """
    figure = Figure(figsize=(5.5 * len(traces), 8.0), layout="constrained")
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
    for name in own:
        colour = INK if name == "reference" else BEFORE if name.endswith("before") else AFTER
        width = 1.4 if name == "reference" else 1.0
        axes.plot(table.index, table[name] / size, color=colour, linewidth=width, label=name)
    axes.set_ylabel(f"{'command' if command else 'reading'} [{printed or '-'}]")
    axes.set_xlabel("time [s]")
    axes.legend(frameon=False, fontsize=7)


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
