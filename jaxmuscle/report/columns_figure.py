"""A picture of the columns of a table as a card takes them, each in the unit in which it stands there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.figure_style import INK, MUTED, STYLE, curve, figure
from jaxmuscle.files import atomic_write
from jaxmuscle.formatting import pretty
from jaxmuscle.recordings.clocks import holds_stamps, stamps_to_seconds
from jaxmuscle.recordings.schema import CLOCK, ColumnSpec
from jaxmuscle.recordings.table import Table
from jaxmuscle.units import Series

PICTURES = (".png", ".svg", ".pdf")
"""Endings of the files that can be drawn."""
PANEL = (7.0, 1.7)
"""Width and height of a panel [in]."""


def draw_columns(table: Table, columns: Mapping[str, ColumnSpec], file: Path) -> None:
    """Draw every column against its clock into `file` (png, svg, pdf).

    Args:
        table: what the bench wrote.
        columns: quantity → column of the table; those that it does not hold, or that hold no numbers, are
            left out. Samples are counted where there is no clock.

    Raises:
        InputError: nothing can be drawn, or the file cannot be written.
    """
    shown = _drawable(table, columns)
    if not shown:
        raise InputError(f"{table.file}: no column to draw")
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        drawing = figure(PANEL[1] * len(shown), PANEL[0])
        panels = np.ravel(drawing.subplots(len(shown), 1, sharex=True))
        for panel, (name, values) in zip(panels, shown.items(), strict=True):
            spec = columns[name]
            curve(panel, _clock(table, columns, spec.column, len(values)), values, color=INK, lw=0.8)
            panel.set_title(_literal(_with_unit(name, spec)))
            panel.set_title(_literal(f"column {spec.column}"), loc="right", color=MUTED, size="small")
        clock = columns.get(CLOCK.name)
        panels[-1].set_xlabel(_literal(_with_unit(CLOCK.name, clock)) if clock else "sample")
        with atomic_write(file) as (unfinished,):
            drawing.savefig(unfinished, dpi=110)


def can_be_drawn(table: Table, columns: Mapping[str, ColumnSpec]) -> bool:
    """Whether any of the columns holds numbers."""
    return bool(_drawable(table, columns))


def _drawable(table: Table, columns: Mapping[str, ColumnSpec]) -> dict[str, Series]:
    read = {name: _numbers(table, spec.column) for name, spec in columns.items() if name != CLOCK.name}
    return {name: values for name, values in read.items() if values is not None}


def _with_unit(name: str, spec: ColumnSpec) -> str:
    """A quantity with its unit, and for a pressure what it counts from: ``pressure [bar gauge]``."""
    unit = " ".join(text for text in (pretty(spec.unit), spec.reference or "") if text)
    return f"{name} [{unit}]" if unit else name


def _literal(text: str) -> str:
    """A text that holds no formula for matplotlib."""
    return text.replace("$", r"\$")


def _numbers(table: Table, column: str) -> Series | None:
    """A column as numbers; `None` of one that is not there or holds none."""
    if column not in table.columns:
        return None
    if holds_stamps(table.entries(column)):
        return stamps_to_seconds(table, column)
    values = table.numbers_or_nan(column)
    return values if np.isfinite(values).any() else None


def _clock(table: Table, columns: Mapping[str, ColumnSpec], column: str, samples: int) -> Series:
    """The times of a column: those of its group, those of the card, or its samples counted."""
    clock = columns.get(CLOCK.name)
    name = table.clocks.get(column, clock.column if clock else "")
    times = _numbers(table, name)
    return times if times is not None and len(times) == samples else np.arange(samples, dtype=float)
