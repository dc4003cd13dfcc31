"""Traces of a tuning in a file of their own: tables over time, compressed, without loss."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmuscle.errors import InputError


def write_traces(file: Path, traces: Mapping[str, pd.DataFrame]) -> None:
    """Write tables by name, each with its columns and its clock, as one ``.npz``."""
    arrays = {"names": np.array(list(traces), dtype=str)}
    for number, table in enumerate(traces.values()):
        arrays[f"columns {number}"] = np.array([str(name) for name in table.columns], dtype=str)
        arrays[f"time {number}"] = table.index.to_numpy(dtype=float)
        arrays[f"values {number}"] = table.to_numpy(dtype=float)
    np.savez_compressed(file, allow_pickle=False, **arrays)


def read_traces(file: Path) -> dict[str, pd.DataFrame]:
    """The inverse of :func:`write_traces`.

    Raises:
        InputError: the file cannot be read, or is another one.
    """
    try:
        with np.load(file, allow_pickle=False) as kept:
            return {
                str(name): pd.DataFrame(
                    kept[f"values {number}"],
                    columns=[str(column) for column in kept[f"columns {number}"]],
                    index=pd.Index(kept[f"time {number}"], name="time"),
                )
                for number, name in enumerate(kept["names"])
            }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{file}: cannot be read as the traces of a tuning: {error}") from error
