"""Parquet files through pyarrow."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd

from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The columns of a Parquet file; a named index of the frame that was written is one of them.

    Raises:
        InputError: not such a file, or pyarrow is not installed.
    """
    library("pyarrow", "pyarrow", path)
    with reading(path, "Parquet"):
        frame = pd.read_parquet(io.BytesIO(content), engine="pyarrow")
    return table_of_frame(path, frame)
