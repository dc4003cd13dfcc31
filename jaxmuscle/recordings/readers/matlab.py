"""MATLAB files: ``.mat`` of versions 4 to 7.2 through SciPy, of version 7.3 as the HDF5 that they are."""

from __future__ import annotations

import io
from pathlib import Path

from scipy.io import loadmat

from jaxmuscle.recordings.readers import hdf5
from jaxmuscle.recordings.readers.library import reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The columns of a MATLAB file: each a variable that is a vector, or all fields of one struct.

    What else the file holds is left alone.

    Raises:
        InputError: not such a file, or one of version 7.3 where h5py is not installed.
    """
    with reading(path, "a MATLAB file"):
        try:
            variables = loadmat(io.BytesIO(content), simplify_cells=True)
        except NotImplementedError:
            return _of_version_7_3(path, content)
    columns = {name: value for name, value in variables.items() if not name.startswith("__")}
    if len(columns) == 1 and isinstance(struct := next(iter(columns.values())), dict):
        columns = struct
    return Table(path, columns, first_row=1)


def _of_version_7_3(path: Path, content: bytes) -> Table:
    """Vectors are matrices of one row or one column there, and structs groups."""
    table = hdf5.read(path, content)
    groups = {name.rpartition("/")[0] for name in table.columns}
    if len(groups) != 1:
        return table
    bare = lambda name: name.rpartition("/")[2]  # noqa: E731
    return Table(path, {bare(name): values for name, values in table.columns.items()}, first_row=1)
