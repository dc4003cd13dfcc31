"""Readers of tables: the ending of a file → the module that reads it, each through one library.

A reader is a module with a function ``read(path, content)`` that gives a
:class:`jaxmuscle.recordings.table.Table`; a LeRobot dataset, which is a folder, has one of its own.
Libraries that not everybody needs are imported when a file asks for them, and belong to the extra ``files``.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers import lerobot_layout
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


def is_of_dataset(path: Path) -> bool:
    """Whether a path is a LeRobot dataset, an episode (``DATASET/episode_000003``) or a data file of one."""
    return lerobot_layout.root_of(path) is not None


def file_of(path: Path) -> Path:
    """The file that holds a table: `path`, or the data file of an episode.

    Raises:
        InputError: an ending that is none of a table; no such episode of a dataset, or several.
    """
    if is_of_dataset(path):
        return _reader("lerobot").file_of(path)
    if table_ending(path) in READERS:
        return path
    got = f"got {path.suffix!r}" if path.suffix else "got none"
    raise InputError(
        f"{path}: expected a table with the ending {', '.join(SUFFIXES)}; {got}. Nor is it a LeRobot dataset "
        f"or DATASET/episode_000000: there is no {lerobot_layout.INFO}"
    )


def read_table(path: Path, content: bytes) -> Table:
    """The table that a path asks for, in the bytes of the file that holds it (:func:`file_of`).

    Raises:
        InputError: an ending that is none of a table, not such a file, or its library is not installed.
    """
    name = "lerobot" if is_of_dataset(path) else READERS[table_ending(file_of(path))]
    return _reader(name).read(path, content)


def _reader(name: str) -> Any:
    return importlib.import_module(f"{__name__}.{name}")
