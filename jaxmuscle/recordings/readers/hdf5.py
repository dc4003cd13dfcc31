"""HDF5 files, ``.h5`` and ``.hdf5``, through h5py."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.recordings.readers.groups import grouped
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table

UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")


def read(path: Path, content: bytes) -> Table:
    """The vectors of an HDF5 file, by their paths: ``group/name``.

    A matrix of one row or one column is a vector (MATLAB has no other); of a dataset of records, such as
    pandas writes (``format="table"``), each field is a column. What else the file holds is left alone.

    Raises:
        InputError: not such a file, or h5py is not installed.
    """
    h5py = library("h5py", "h5py", path)
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}

    def visit(name: str, node: Any) -> None:
        if not isinstance(node, h5py.Dataset) or name.startswith("#"):
            return
        if node.dtype.names:
            records = node[()]
            columns.update({f"{name}/{field}": records[field] for field in node.dtype.names})
        elif node.dtype.kind in "iufb" and node.size == max(node.shape, default=0):
            columns[name] = np.ravel(node[()])
            unit = next((node.attrs[key] for key in UNIT_ATTRIBUTES if key in node.attrs), None)
            if isinstance(unit, str | bytes):
                units[name] = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit

    with reading(path, "HDF5"), h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(visit)
    flat = {name: values for name, values in columns.items() if values.ndim == 1}
    return grouped(path, flat, units)
