"""NumPy files: ``.npz`` of vectors, ``.npy`` of records."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.groups import grouped
from jaxmuscle.recordings.readers.library import reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The arrays of a ``.npz`` that are vectors, or the fields of the records in a ``.npy``.

    Raises:
        InputError: not such a file, a ``.npy`` whose columns have no names, or pickled objects, which are not
            loaded since they can run any program.
    """
    with reading(path, "a file of NumPy"):
        loaded = np.load(io.BytesIO(content), allow_pickle=False)
        several = isinstance(loaded, np.lib.npyio.NpzFile)
        arrays = {name: loaded[name] for name in loaded.files} if several else {"": loaded}
    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if array.dtype.names:
            begin = f"{name}/" if name else ""
            columns.update({begin + field: np.ravel(array[field]) for field in array.dtype.names})
        elif array.ndim == 1 and name:
            columns[name] = array
    if not columns and "" in arrays:
        raise InputError(
            f"{path}: expected an array of records, whose fields have names; got {arrays[''].dtype} of shape "
            f"{arrays[''].shape}. Write the columns with numpy.savez(file, time=…, pressure=…)"
        )
    return grouped(path, columns, {})
