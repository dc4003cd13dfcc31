"""Readers of tables: the ending of a file → the module that reads it, each through one library.

A reader is a module with a function ``read(path, content)`` that gives a
:class:`jaxmuscle.recordings.table.Table`. Libraries that not everybody needs are imported when a file
asks for them, and belong to the extra ``files``.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.table import Table

READERS = {
    ".csv": "delimited",
    ".tsv": "delimited",
    ".txt": "delimited",
    ".csv.gz": "delimited",
    ".tsv.gz": "delimited",
    ".txt.gz": "delimited",
    ".mat": "matlab",
    ".parquet": "parquet",
    ".xlsx": "excel",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".npy": "numpy_arrays",
    ".npz": "numpy_arrays",
    ".tdms": "tdms",
    ".mf4": "mdf",
    ".mcap": "bags",
    ".db3": "bags",
    ".bag": "bags",
}
"""Ending → module of this package."""
SUFFIXES = tuple(READERS)


def table_ending(path: Path) -> str:
    """The ending by which a table is read, in lower case; the last one of the name when none is known."""
    return next((e for e in SUFFIXES if path.name.lower().endswith(e)), path.suffix.lower())


def table_name(path: Path) -> str:
    """The name of a table without its ending: ``bench`` of ``bench.csv.gz``."""
    return path.name[: len(path.name) - len(table_ending(path))]


def check_ending(path: Path) -> None:
    """Raise `InputError` unless a table can be read by its ending."""
    if table_ending(path) not in READERS:
        got = f"got {path.suffix!r}" if path.suffix else "got none"
        raise InputError(f"{path}: expected a table with the ending {', '.join(SUFFIXES)}; {got}")


def read_table(path: Path, content: bytes) -> Table:
    """The table in the bytes of a file, of the kind that its ending says.

    Raises:
        InputError: an ending that is none of a table, not such a file, or its library is not installed.
    """
    check_ending(path)
    reader = importlib.import_module(f"{__name__}.{READERS[table_ending(path)]}")
    return reader.read(path, content)
