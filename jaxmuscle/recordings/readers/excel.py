"""Excel workbooks, ``.xlsx``, through openpyxl."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.dialect import are_units
from jaxmuscle.recordings.readers.groups import grouped
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The columns of a workbook: names in a row, perhaps units below it, samples below these.

    The columns of several sheets with samples are called ``sheet/column``. Of formulae the values that were
    last computed are taken.

    Raises:
        InputError: not such a file, or openpyxl is not installed.
    """
    library("openpyxl", "openpyxl", path)
    with reading(path, "a workbook"):
        sheets = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None, engine="openpyxl")
    tables = {name: found for name, sheet in sheets.items() if (found := _sheet(path, sheet)) is not None}
    if not tables:
        raise InputError(f"{path}: no sheet holds names with samples below them")
    if len(tables) == 1:
        return next(iter(tables.values()))
    both = [(f"{sheet}/", table) for sheet, table in tables.items()]
    columns = {begin + name: values for begin, table in both for name, values in table.columns.items()}
    units = {begin + name: unit for begin, table in both for name, unit in table.units.items()}
    return grouped(path, columns, units)


def _sheet(path: Path, sheet: pd.DataFrame) -> Table | None:
    """The table in a sheet, `None` if it holds none: below remarks, the first row of texts over numbers."""
    sheet = sheet.loc[:, sheet.notna().any()]
    head = sheet.head(50)
    samples = [i for i in range(len(head)) if 2 * sum(map(_is_sample, head.iloc[i])) > head.shape[1]]
    if not samples or samples[0] == 0:
        return None
    first = samples[0]
    texts = [["" if _is_empty(cell) else str(cell).strip() for cell in head.iloc[i]] for i in range(first)]
    above = [row for row in texts if all(row)] or texts[-1:]
    below = above[1] if len(above) > 1 and are_units(above[1], above[0]) else None
    names = above[0] if below or len(above) == 1 else above[-1]
    if twice := sorted({name for name in names if name and names.count(name) > 1}):
        raise InputError(f"{path}: several columns named {', '.join(map(repr, twice))}; rename them")
    body = sheet.iloc[first:].infer_objects()
    columns = {name: body.iloc[:, i].reset_index(drop=True) for i, name in enumerate(names) if name}
    units = {n: u.strip("[]() ") for n, u in zip(names, below or [], strict=False) if u.strip("[]()- ")}
    return Table(path, columns, first_row=first + 1, units=units)


def _is_empty(cell: Any) -> bool:
    return bool(pd.isna(cell))


def _is_sample(cell: Any) -> bool:
    """Whether a cell holds a number or a time."""
    number = isinstance(cell, int | float | np.number) and not isinstance(cell, bool)
    return (number or hasattr(cell, "isoformat")) and not _is_empty(cell)
