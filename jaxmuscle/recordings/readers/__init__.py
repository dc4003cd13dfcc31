"""Readers of tables: the ending of a file → the module that reads it, each through one library.

A reader is a module with a function ``read(path, content)`` that gives a
:class:`jaxmuscle.recordings.table.Table`; a LeRobot dataset, which is a folder, has one of its own, and the
folder that ``ros2 bag record`` makes is read by the file in it.
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
BAG_FILES = (".db3", ".mcap")
"""Endings of the file in the folder of a bag of ROS 2."""


def table_ending(path: Path) -> str:
    """The ending by which a table is read, in lower case; the last one of the name when none is known."""
    unknown = "" if is_bag(path) else path.suffix.lower()
    return next((e for e in SUFFIXES if path.name.lower().endswith(e)), unknown)


def table_name(path: Path) -> str:
    """The name of a table without its ending: ``bench`` of ``bench.csv.gz``."""
    return path.name[: len(path.name) - len(table_ending(path))]


def is_of_dataset(path: Path) -> bool:
    """Whether a path is a LeRobot dataset, an episode (``DATASET/episode_000003``) or a data file of one."""
    return lerobot_layout.root_of(path) is not None


def is_bag(path: Path) -> bool:
    """Whether a path is a bag of ROS 2 as ``ros2 bag record`` leaves it: a folder with ``metadata.yaml``."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def file_of(path: Path) -> Path:
    """The file that holds a table: `path`, the one in the folder of a bag, or the data file of an episode.

    Raises:
        InputError: an ending that is none of a table; no such episode of a dataset, or several; a bag in
            several files, or in one that is none.
    """
    if is_of_dataset(path):
        return _reader("lerobot").file_of(path)
    if is_bag(path):
        return _file_of_bag(path)
    if table_ending(path) in READERS:
        return path
    got = f"got {path.suffix!r}" if path.suffix else "got none"
    raise InputError(
        f"{path}: expected a table with the ending {', '.join(SUFFIXES)}; {got}. Nor is it a LeRobot dataset "
        f"or DATASET/episode_000000: there is no {lerobot_layout.INFO}, nor the folder of a bag of ROS 2: "
        f"there is no metadata.yaml"
    )


def _file_of_bag(folder: Path) -> Path:
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in BAG_FILES)
    if len(files) == 1:
        return files[0]
    if files:
        raise InputError(
            f"{folder}: the bag is in {len(files)} files, {files[0].name} to {files[-1].name}; expected one. "
            f"Name one of them, or join them: ros2 bag convert"
        )
    raise InputError(
        f"{folder}: expected a file {' or '.join(BAG_FILES)} in the folder of a bag of ROS 2; got none. "
        f"A compressed bag has to be decompressed first: ros2 bag convert"
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
