"""Parquet files through pyarrow."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.readers.library import library
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The columns of a Parquet file; a named index of the frame that was written is one of them.

    Raises:
        InputError: not such a file, or pyarrow is not installed.
    """
    pyarrow = library("pyarrow", "pyarrow", path)
    try:
        frame = pd.read_parquet(io.BytesIO(content), engine="pyarrow")
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as Parquet: {error}") from error
    return table_of_frame(path, frame)
