"""Tables: columns as a file holds them, of numbers or of texts."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.errors import InputError, nearest

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Table:
    """Columns of a file.

    Attributes:
        file: where they stand; of a table in memory, what messages call it.
        columns: name → samples, as they were read; those of a group or topic are called ``group/channel``.
        first_row: number that the file's user gives to its first sample.
        rows: the same of every sample, where lines that are no samples stand between them.
        units: column → unit that the file itself gives it, as it is written there.
        clocks: column → column that holds its times, in a file whose groups or topics have a clock each.
        set_aside: what the file calls a column and is none here → why, the end of a sentence about it.
    """

    file: Path | str
    columns: Mapping[str, Any]
    first_row: int
    rows: NDArray[np.intp] | None = None
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    clocks: Mapping[str, str] = dataclasses.field(default_factory=dict)
    set_aside: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def row(self, index: int | np.integer) -> int:
        """The row in the file of the sample at `index`."""
        return int(index) + self.first_row if self.rows is None else int(self.rows[index])

    def entries(self, column: str) -> NDArray[Any]:
        """A column as the file has it; `InputError` when it is absent or no vector of real entries."""
        if column not in self.columns:
            raise InputError(self.absence(column))
        entries = np.asarray(self.columns[column])
        if entries.ndim != 1 or entries.dtype.kind == "c":
            got = f"got {entries.dtype} of shape {entries.shape}"
            raise InputError(f"expected a vector of real numbers; {got}")
        return entries

    def numbers(self, column: str) -> NDArray[np.float64]:
        """A column as numbers; `InputError` when it is absent or names the first entry that is no number."""
        values = self.numbers_or_nan(column)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(self._not_a_number(pd.Series(self.entries(column)).iloc[bad[0]], bad))
        return values

    def numbers_or_nan(self, column: str) -> NDArray[np.float64]:
        """A column as numbers, NaN where it holds something else; `InputError` when it is absent."""
        return np.asarray(pd.to_numeric(pd.Series(self.entries(column)), errors="coerce"), dtype=float)

    def absence(self, column: str) -> str:
        """Why a column is not there, the end of a sentence about it."""
        if column in self.set_aside:
            return self.set_aside[column]
        return f"is not in the table{nearest(column, self.columns)}{self._listed(column)}"

    def _listed(self, column: str) -> str:
        """All columns, unless the message has them already."""
        near = nearest(column, self.columns, all_if_none_near=False)
        return f" Its columns are {', '.join(self.columns)}" if near else ""

    def _not_a_number(self, entry: Any, bad: NDArray[np.intp]) -> str:
        got = repr(entry) if isinstance(entry, str) else "an empty field or NaN" if pd.isna(entry) else entry
        count = "" if bad.size == 1 else f" ({bad.size} such rows)"
        remedy = "mend or cut out such rows"
        if isinstance(entry, str) and DECIMAL_COMMA.fullmatch(entry.strip()):
            remedy = "write all numbers of the table with points, or all with commas"
        elif isinstance(entry, str) and bad[0] == 0 and bad.size == 1:
            remedy = "if this is a second line of names or units, remove it"
        return f"row {self.row(bad[0])}: expected a number; got {got}{count}; {remedy}"
