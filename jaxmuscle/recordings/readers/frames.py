"""Tables in memory: a pandas DataFrame, and an xarray Dataset with one axis of samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.table import Table


def table_of_frame(path: Path | str, frame: pd.DataFrame) -> Table:
    """The columns of a frame, its index among them where it has a name; names are texts.

    Raises:
        InputError: two columns of one name, or names of several levels.
    """
    if isinstance(frame.columns, pd.MultiIndex) or isinstance(frame.index, pd.MultiIndex):
        raise InputError(f"{path}: expected columns and rows with one level of names; got several")
    if frame.index.name is not None and frame.index.name not in frame.columns:
        frame = frame.reset_index()
    names = [str(name) for name in frame.columns]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{path}: several columns named {', '.join(map(repr, twice))}; rename them")
    columns = {name: frame.iloc[:, i].reset_index(drop=True) for i, name in enumerate(names)}
    return Table(path, columns, first_row=0 if isinstance(path, str) else 1)


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
