"""Rows that a card names: to be ignored, held out, and where a new run begins, in times of the table's clock.

``slack = { from = 12, to = 14.5, unit = "s" }`` in ``[ignore]``, ``last_run = { from = 40, unit = "s" }`` in
``[held_out]``, ``second_run = { at = 30, unit = "s" }`` in ``[breaks]``. The keys are names of the user's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.recordings.schema import Need, Quantity, read_quantity, written_quantity

IGNORE, HELD_OUT, BREAKS = "ignore", "held_out", "breaks"
KEYS = {IGNORE: ("from", "to", "unit", "column"), HELD_OUT: ("from", "to", "unit"), BREAKS: ("at", "unit")}
"""Section → what its entries may say."""
TIME = Need("s", "time of the table's clock")
Rows = NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class RowSpan:
    """Rows from one time of the clock to another, both included; with a break, its time is both.

    Attributes:
        begin, end: times [s]; `None` for the beginning or the end of the table.
        unit: in which they are written.
        column: the reading that is meant, `None` for all.
    """

    begin: float | None
    end: float | None
    unit: str = "s"
    column: str | None = None

    def rows(self, time: NDArray[np.float64]) -> Rows:
        """The rows of a clock [s] that lie within."""
        first = -np.inf if self.begin is None else self.begin
        last = np.inf if self.end is None else self.end
        # What is written in decimals and what is counted in steps may differ by rounding.
        near = 1e-6 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        return (time >= first - near) & (time <= last + near)


def read_row_span(section: str, entry: object, columns: Mapping[str, Need]) -> RowSpan:
    """The rows that an entry of `section` names.

    Args:
        columns: measured columns, which an entry to be ignored may name.

    Raises:
        InputError: another form, a unit that is no time, an end before the beginning, an unknown column.
    """
    form = "{ at = …" if section == BREAKS else "{ from = …, to = …"
    form += ', unit = "s" }'
    if not isinstance(entry, Mapping) or not entry.keys() & {"from", "to", "at"}:
        raise InputError(f"expected {form}; got {entry!r}")
    for key in entry:
        if key not in KEYS[section]:
            raise InputError(f"unknown key {key!r}{nearest(str(key), KEYS[section])}")
    times = {key: _time(entry, key) for key in ("from", "to", "at") if key in entry}
    begin, end = (times.get(key, times.get("at")) for key in ("from", "to"))
    if begin is not None and end is not None and not begin <= end:
        raise InputError(f"expected a span that ends after it begins; got {entry['from']} to {entry['to']}")
    column = entry.get("column")
    if column is not None and not (isinstance(column, str) and column in columns):
        raise InputError(f"unknown column {column!r}{nearest(str(column), columns)}")
    return RowSpan(begin, end, str(entry["unit"]), column)


def _time(entry: Mapping[str, Any], key: str) -> float:
    given = {"value": entry[key], **({"unit": entry["unit"]} if "unit" in entry else {})}
    try:
        return read_quantity(given, TIME, 0.0, keys=("value", "unit")).value
    except InputError as error:
        raise InputError(f"{key}: {error}") from error


def written_row_span(section: str, span: RowSpan) -> dict[str, str | float]:
    """The entry that reads back as `span`."""
    ends = {"at": span.begin} if section == BREAKS else {"from": span.begin, "to": span.end}
    entry: dict[str, str | float] = {
        key: written_quantity(Quantity(time, unit=span.unit), TIME, 0.0)["value"]
        for key, time in ends.items()
        if time is not None
    }
    column = {} if span.column is None else {"column": span.column}
    return {**entry, "unit": span.unit, **column}


@dataclasses.dataclass(frozen=True)
class NamedRows:
    """What the spans of a card are in a table.

    Attributes:
        ignored: column → rows whose reading does not count.
        held_out: rows that no fit may see; `None` where the card names none.
        breaks: rows at which a new run begins.
    """

    ignored: dict[str, Rows]
    held_out: Rows | None
    breaks: tuple[int, ...]


def named_rows(
    spans: Mapping[str, Mapping[str, RowSpan]],
    time: NDArray[np.float64],
    columns: tuple[str, ...],
    file: str,
    *,
    stretch: bool = False,
) -> NamedRows:
    """The rows that a card names.

    Args:
        spans: section → name → span.
        time: the clock of the table [s].
        columns: what is measured.
        file: the table, for messages.
        stretch: whether the clock is a stretch of the table's: it need not hold what the card names.

    Raises:
        InputError: a span without a row, a break at the first row or behind the last.
    """
    if stretch:
        spans = {section: _inside(named, time, section) for section, named in spans.items()}
    ignored: dict[str, Rows] = {}
    for name, span in spans[IGNORE].items():
        rows = _some(span, time, f"{file}: [{IGNORE}] {name}")
        for column in columns if span.column is None else (span.column,):
            ignored[column] = ignored.get(column, np.zeros(len(time), dtype=bool)) | rows
    held_out = None
    for name, span in spans[HELD_OUT].items():
        rows = _some(span, time, f"{file}: [{HELD_OUT}] {name}")
        held_out = rows if held_out is None else held_out | rows
    breaks = []
    for name, span in spans[BREAKS].items():
        row = _row_at(span, time)
        if not 0 < row < len(time):
            raise InputError(
                f"{file}: [{BREAKS}] {name}: expected a time after the first row and not after the last; "
                f"{_clock(time)}"
            )
        breaks.append(row)
    return NamedRows(ignored, held_out, tuple(sorted(set(breaks))))


def _inside(spans: Mapping[str, RowSpan], time: NDArray[np.float64], section: str) -> dict[str, RowSpan]:
    """Those that hold a row of a clock; of breaks those after its first row."""
    if section == BREAKS:
        return {name: span for name, span in spans.items() if 0 < _row_at(span, time) < len(time)}
    return {name: span for name, span in spans.items() if span.rows(time).any()}


def _row_at(span: RowSpan, time: NDArray[np.float64]) -> int:
    """The first row from its time on; one behind the last row where there is none."""
    later = RowSpan(span.begin, None).rows(time)
    return int(np.argmax(later)) if later.any() else len(time)


def _some(span: RowSpan, time: NDArray[np.float64], where: str) -> Rows:
    rows = span.rows(time)
    if not rows.any():
        raise InputError(f"{where}: no row lies there; {_clock(time)}")
    return rows


def _clock(time: NDArray[np.float64]) -> str:
    return f"the clock runs from {time[0]:g} s to {time[-1]:g} s"
