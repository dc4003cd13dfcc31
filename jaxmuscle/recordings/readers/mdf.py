"""MDF 4 files of measurement systems of vehicles, ``.mf4``, through asammdf."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.recordings.readers.groups import CLOCK, grouped
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The channels of an MDF file, ``group/channel``, with their units; ``group/time`` is their clock.

    A group goes by its acquisition name, or by its number from 0; times are seconds since the measurement
    began.

    Raises:
        InputError: not such a file, or asammdf is not installed.
    """
    asammdf = library("asammdf", "asammdf", path)
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    with reading(path, "MDF"), asammdf.MDF(io.BytesIO(content)) as file:
        names = [group.channel_group.acq_name or str(i) for i, group in enumerate(file.groups)]
        for index, name in enumerate(names):
            group = name if names.count(name) == 1 else f"{name} {index}"
            for signal in file.select([(None, index, i) for i in _channels(file, index)]):
                if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "iufb":
                    continue
                column, clock = f"{group}/{signal.name}", f"{group}/{CLOCK}"
                columns[clock], columns[column] = (
                    np.asarray(signal.timestamps),
                    np.asarray(signal.samples),
                )
                clocks[column] = clocks[clock] = clock
                units[clock] = "s"
                if signal.unit:
                    units[column] = signal.unit
    return grouped(path, columns, units, clocks)


def _channels(file: Any, index: int) -> list[int]:
    """The channels of a group without its clock."""
    master = file.masters_db.get(index)
    return [i for i in range(len(file.groups[index].channels)) if i != master]
