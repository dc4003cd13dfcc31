"""Tables in memory: a pandas DataFrame, and an xarray Dataset with one axis of samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.groups import LONGEST
from jaxmuscle.recordings.table import Table

NUMBERED: Mapping[str, Sequence[str]] = MappingProxyType({})
NESTED = (list, tuple, np.ndarray, Mapping)


def table_of_frame(
    path: Path | str, frame: pd.DataFrame, names_of_entries: Mapping[str, Sequence[str]] = NUMBERED
) -> Table:
    """The columns of a frame, its index among them where it has a name; names are texts.

    Of lists of numbers, as many in each row, the entries are columns: ``column.0``, ``column.1``, or by name.

    Args:
        path: where it stands.
        frame: one row for each sample.
        names_of_entries: column → names of its entries; taken where they are as many.

    Raises:
        InputError: two columns of one name, or names of several levels.
    """
    if isinstance(frame.columns, pd.MultiIndex) or isinstance(frame.index, pd.MultiIndex):
        raise InputError(f"{path}: expected columns and rows with one level of names; got several")
    if frame.index.name is not None and frame.index.name not in frame.columns:
        frame = frame.reset_index()
    found: list[tuple[str, Any]] = []
    set_aside: dict[str, str] = {}
    for i, name in enumerate(map(str, frame.columns)):
        column = frame.iloc[:, i].reset_index(drop=True)
        if not _is_nested(column):
            found.append((name, column))
            continue
        entries = _entries(column)
        if isinstance(entries, str):
            set_aside[name] = entries
            continue
        given = names_of_entries.get(name, ())
        own = given if len(given) == entries.shape[1] else range(entries.shape[1])
        parts = [f"{name}.{each}" for each in own]
        found += zip(parts, entries.T, strict=True)
        set_aside[name] = f"holds a list in every row, whose entries are the columns {', '.join(parts)}"
    names = [name for name, _ in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{path}: several columns named {', '.join(map(repr, twice))}; rename them")
    return Table(path, dict(found), first_row=0 if isinstance(path, str) else 1, set_aside=set_aside)


def _is_nested(column: pd.Series) -> bool:
    """Whether a column holds lists or records, by its first entry that is not empty."""
    there = column.dropna() if column.dtype == object else column.iloc[:0]
    return len(there) > 0 and isinstance(there.iloc[0], NESTED)


def _entries(column: pd.Series) -> NDArray[np.float64] | str:
    """Lists as the rows of a matrix, NaN where there is none; or why they are not columns."""
    there = column.notna().to_numpy()
    lists = [each for each, is_there in zip(column, there, strict=True) if is_there]
    if any(not isinstance(each, NESTED) or isinstance(each, Mapping) for each in lists):
        return "holds records, which are no columns"
    lengths = sorted({len(each) for each in lists})
    if len(lengths) > 1:
        return f"holds lists of {lengths[0]} to {lengths[-1]} entries; expected as many in every row"
    if not 0 < lengths[0] <= LONGEST:
        return f"holds lists of {lengths[0]} entries; expected 1 to {LONGEST}, longer ones are no columns"
    matrix = np.full((len(column), lengths[0]), np.nan)
    try:
        matrix[there] = np.asarray(lists, dtype=float)
    except (TypeError, ValueError):
        return "holds lists of something else than numbers"
    return matrix


def table_of_dataset(dataset: xr.Dataset) -> Table:
    """The variables and coordinates of a dataset along its one axis, with their attribute ``units``.

    Raises:
        InputError: variables along other axes than one.
    """
    what = "xarray Dataset"
    if len(dataset.sizes) != 1:
        raise InputError(f"{what}: expected one axis, that of the samples; got {dict(dataset.sizes)}")
    there = {str(name): each for name, each in dataset.variables.items() if each.ndim == 1}
    units = {name: str(each.attrs["units"]) for name, each in there.items() if "units" in each.attrs}
    return Table(what, {name: each.values for name, each in there.items()}, first_row=0, units=units)


def table_in_memory(data: Any) -> Table:
    """The table of a frame or a dataset; `InputError` for anything else."""
    if isinstance(data, pd.DataFrame):
        return table_of_frame("DataFrame", data)
    if isinstance(data, xr.Dataset):
        return table_of_dataset(data)
    raise InputError(
        f"expected the path of a table, a pandas DataFrame or an xarray Dataset; got {type(data).__name__}"
    )
