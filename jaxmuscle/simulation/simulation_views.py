"""Figure of a simulation, and what a notebook shows of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.formatting import join, printed_unit, rounded, words
from jaxmuscle.notebook_html import Sparkline, Table, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL = (8.0, 2.1)
"""Width and height of the panel of a reading [in]."""
Measured = tuple[NDArray[np.float64], Mapping[str, NDArray[np.float64]]]
"""Clock [s] and columns of a recording."""


def simulation_figure(
    table: pd.DataFrame, units: Mapping[str, str], measured: Measured | None = None
) -> Figure:
    """A panel for each column of `table`, with the measured column of the same name beneath it."""
    import matplotlib as mpl  # with the first figure, not with the classes

    from jaxmuscle.figure_style import AFTER, INK, STYLE, curve, figure

    clock, columns = measured if measured is not None else (np.array([]), {})
    if measured is not None and not set(columns) & set(table):
        raise InputError(
            f"plot: the recording has {', '.join(columns)}, the simulation {', '.join(map(str, table))}: "
            f"expected a recording of the same rig"
        )
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = figure(PANEL[1] * len(table.columns), PANEL[0])
        panels: Any = drawing.subplots(len(table.columns), 1, sharex=True, squeeze=False)[:, 0]
        for panel, name in zip(panels, map(str, table), strict=True):
            values, own = table[name].to_numpy(dtype=float), columns.get(name)
            size, unit = _size(name, values, units)
            if own is not None:
                curve(panel, clock, own / size, color=INK, lw=2.0, label="measured")
            curve(panel, table.index.to_numpy(), values / size, color=AFTER, lw=1.3, label="simulated")
            panel.set_ylabel(words(name) + (f" [{unit}]" if unit else ""))
            panel.margins(x=0.005)
        if measured is not None:
            panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
    return drawing


def simulation_view(table: pd.DataFrame, units: Mapping[str, str]) -> View:
    """Every reading with its range and course."""
    rows = []
    for name in map(str, table):
        values = table[name].to_numpy(dtype=float)
        size, unit = _size(name, values, units)
        finite = values[np.isfinite(values)]
        ends = [join(rounded(e / size, 4), unit) for e in (finite.min(), finite.max())] if len(finite) else []
        rows.append((words(name), *(ends or ("", "")), Sparkline(values)))
    begin, end = table.index[0], table.index[-1]
    facts = [f"{len(table)} samples", f"{begin:.4g} to {end:.4g} s"]
    return View("simulation", "", facts, tables=[Table("readings", ("", "from", "to", ""), rows)])


def _size(name: str, values: NDArray[np.float64], units: Mapping[str, str]) -> tuple[float, str]:
    """Unit of the right size for a reading; those of several muscles are numbered."""
    unit = units.get(name, units.get(re.sub(r"_\d+$", "", name), ""))
    size, printed = printed_unit(unit, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    return size, f"{printed} absolute" if unit == "Pa" else printed
