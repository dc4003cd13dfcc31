"""Tables of numbers as files hold them, and resampling from an irregular clock to a uniform one."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import re
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.units import Series

SUFFIXES = (".csv", ".mat")
SEPARATORS = {";": "semicolons", "\t": "tabs"}
"""What columns are separated by in tables that are not read, for the message."""
ROWS_SEEN = 20
"""Rows from which the separator is told."""
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Table:
    """Columns of a file; `first_row` is the number that the file's user gives to its first sample."""

    file: Path
    columns: Mapping[str, Any]
    first_row: int

    def row(self, index: int | np.integer) -> int:
        """The row in the file of the sample at `index`."""
        return int(index) + self.first_row

    def numbers(self, column: str) -> NDArray[np.float64]:
        """A column as numbers; `InputError` when it is absent or names the first entry that is no number."""
        if column not in self.columns:
            raise InputError(f"is not in the table{nearest(column, self.columns)}{self._listed(column)}")
        entries = np.asarray(self.columns[column])
        if entries.ndim != 1 or entries.dtype.kind == "c":
            got = f"got {entries.dtype} of shape {entries.shape}"
            raise InputError(f"expected a vector of real numbers; {got}")
        series = pd.Series(entries)
        values = np.asarray(pd.to_numeric(series, errors="coerce"), dtype=float)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(self._not_a_number(series.iloc[bad[0]], bad))
        return values

    def _listed(self, column: str) -> str:
        """All columns, unless the message has them already."""
        near = nearest(column, self.columns, all_if_none_near=False)
        return f" Its columns are {', '.join(self.columns)}" if near else ""

    def _not_a_number(self, entry: Any, bad: NDArray[np.intp]) -> str:
        got = repr(entry) if isinstance(entry, str) else "an empty field or NaN" if pd.isna(entry) else entry
        count = "" if bad.size == 1 else f" ({bad.size} such rows)"
        remedy = "mend or cut out such rows"
        if isinstance(entry, str) and DECIMAL_COMMA.fullmatch(entry.strip()):
            remedy = "write numbers with points, not commas"
        elif isinstance(entry, str) and bad[0] == 0 and bad.size == 1:
            remedy = "if this is a line of units, remove it: units stand in the card"
        return f"row {self.row(bad[0])}: expected a number; got {got}{count}; {remedy}"


def read_table(path: Path, content: bytes) -> Table:
    """The table in the bytes of a file, of the kind that its ending says.

    ``.csv``: comma-separated, decimal points, names in row 1. ``.mat`` (versions 4 to 7.2): each column a
    variable that is a vector, or all columns fields of one struct; what else the file holds is left alone.

    Raises:
        InputError: not such a file.
    """
    return _read_csv(path, content) if path.suffix.lower() == ".csv" else _read_mat(path, content)


def _read_csv(path: Path, content: bytes) -> Table:
    try:
        text = content.decode("utf-8-sig")
        names = _names(path, text)
        # Blank lines stay rows, so that the numbers of rows are those of the file.
        frame = pd.read_csv(
            io.BytesIO(content),
            header=0,
            encoding="utf-8-sig",
            skipinitialspace=True,
            skip_blank_lines=False,
            low_memory=False,
        )
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    except (pd.errors.EmptyDataError, pd.errors.ParserError, csv.Error) as error:
        reason = str(error).strip().removeprefix("Error tokenizing data. C error: ")
        raise InputError(f"{path}: cannot be read as a comma-separated table: {reason}") from error
    _check_header(path, names, frame)
    frame.columns = names
    filled = np.flatnonzero(frame.notna().any(axis=1).to_numpy())
    frame = frame.iloc[: filled[-1] + 1] if filled.size else frame.iloc[:0]
    return Table(path, {name: frame[name] for name in names}, first_row=2)


def _names(path: Path, text: str) -> list[str]:
    """The names in row 1; `InputError` when the table is separated by something else than commas."""
    first = list(itertools.islice(io.StringIO(text, newline=""), ROWS_SEEN))
    as_commas = list(_rows(first, ","))
    for separator, name in SEPARATORS.items():
        rows = list(_rows(first, separator))
        if _holds_together(rows) and (not _holds_together(as_commas) or _all_numbers(rows)):
            raise InputError(
                f"{path}: columns are separated by {name}; expected commas, with points in the numbers. "
                f"Export it so, or replace them"
            )
    names = as_commas[0] if as_commas else []
    if names and 2 * sum(len(row) > len(names) for row in as_commas[1:]) > len(as_commas) - 1:
        raise _longer(path, names)
    return names


def _longer(path: Path, names: list[str]) -> InputError:
    return InputError(
        f"{path}: rows hold more fields than row 1 holds names ({len(names)}); mend row 1, or write points "
        f"in the numbers if they have commas"
    )


def _rows(lines: list[str], separator: str) -> Iterator[list[str]]:
    """The fields of all lines that are not blank; a separator within quotes is part of a name."""
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    return ([field.strip() for field in row] for row in reader if any(field.strip() for field in row))


def _holds_together(rows: list[list[str]]) -> bool:
    """Whether there are several columns, and most rows have as many fields as the first has names."""
    if not rows or len(rows[0]) < 2:
        return False
    return 2 * sum(len(row) == len(rows[0]) for row in rows[1:]) >= len(rows) - 1


def _all_numbers(rows: list[list[str]]) -> bool:
    """Whether most rows below the names hold numbers only, with points or commas."""
    return 2 * sum(all(NUMBER.fullmatch(field) for field in row) for row in rows[1:]) > len(rows) - 1


def _check_header(path: Path, names: list[str], frame: pd.DataFrame) -> None:
    if not isinstance(frame.index, pd.RangeIndex) or len(frame.columns) != len(names):
        raise _longer(path, names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}, row 1: several columns named {', '.join(map(repr, twice))}; rename them")


def _read_mat(path: Path, content: bytes) -> Table:
    try:
        variables = loadmat(io.BytesIO(content), simplify_cells=True)
    except NotImplementedError as error:
        raise InputError(f"{path}: saved as version 7.3; save it with the option '-v7'") from error
    except (MatReadError, ValueError, TypeError, KeyError, OSError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read as a MATLAB file: {error}") from error
    columns = {name: value for name, value in variables.items() if not name.startswith("__")}
    if len(columns) == 1 and isinstance(struct := next(iter(columns.values())), dict):
        columns = struct
    return Table(path, columns, first_row=1)


def resampled(
    time: Series, columns: Mapping[str, Series], held: Collection[str]
) -> tuple[Series, dict[str, Series]]:
    """(time, columns) on a uniform clock with the median step, from the first sample on.

    Measured columns are interpolated linearly. A command acts from its sample to the next, so its new
    value is the mean of the held command over the new interval, which neither delays nor advances it.

    Args:
        time: increasing [s].
        columns: quantity → samples.
        held: the quantities that are commands.
    """
    step = float(np.median(np.diff(time)))
    # The small addition keeps the last sample when the clock is uniform up to rounding.
    clock = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    return clock, {
        name: _mean_of_held(time, values, clock, step) if name in held else np.interp(clock, time, values)
        for name, values in columns.items()
    }


def _mean_of_held(time: Series, values: Series, clock: Series, step: float) -> Series:
    """Mean over [t, t + step) of a signal that keeps each value until the next; the last one lasts."""
    ends = np.append(time, clock[-1] + step)
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
    edges = np.append(clock, clock[-1] + step)
    return np.diff(np.interp(edges, ends, integral)) / step
