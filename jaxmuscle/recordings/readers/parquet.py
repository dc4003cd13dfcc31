"""Parquet files through pyarrow."""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path

import pandas as pd

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table

POINTER = b"version https://git-lfs"
"""How a file begins that stands for one which was not fetched."""


def read(path: Path, content: bytes) -> Table:
    """The columns of a Parquet file; a named index of the frame that was written is one of them.

    Of lists of one length the entries are columns, ``name.0``, ``name.1``.

    Raises:
        InputError: not such a file, or pyarrow is not installed.
    """
    return table_of_frame(path, frame_in(path, content))


def frame_in(
    path: Path, content: bytes, unread: Collection[str] = (), rows: list[tuple[str, str, int]] | None = None
) -> pd.DataFrame:
    """The frame in a Parquet file; errors as of :func:`read`.

    Args:
        path: begins the message.
        content: of the file.
        unread: columns that are left where they are.
        rows: which rows are taken, ``[("episode_index", "==", 3)]``; all when not given.
    """
    library("pyarrow", "pyarrow", path)
    if content.startswith(POINTER):
        raise InputError(f"{path}: is a pointer of Git LFS, not the file itself; fetch it with git lfs pull")
    with reading(path, "Parquet"):
        parquet = library("pyarrow.parquet", "pyarrow", path)
        there = parquet.read_schema(io.BytesIO(content)).names if unread else []
        columns = [name for name in there if name not in unread] if unread else None
        return pd.read_parquet(io.BytesIO(content), engine="pyarrow", columns=columns, filters=rows)
