"""TDMS files of LabVIEW through nptdms."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.recordings.readers.groups import CLOCK, grouped
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table


def read(path: Path, content: bytes) -> Table:
    """The channels of a TDMS file, ``group/channel``, with their property ``unit_string``.

    Waveforms have no channel of times; their clock, from the start and the increment that they carry, is the
    column ``group/time``, in seconds since the earliest start in the file (``group/channel time`` where the
    waveforms of a group differ).

    Raises:
        InputError: not such a file, or nptdms is not installed.
    """
    nptdms = library("nptdms", "nptdms", path)
    with reading(path, "TDMS"):
        file = nptdms.TdmsFile.read(io.BytesIO(content))
        channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
        arrays = {f"{group}/{channel.name}": channel[:] for group, channel in channels}
    starts = [
        c.properties["wf_start_time"] for _, c in channels if c.properties.get("wf_start_time") is not None
    ]
    zero = min(starts) if starts else None
    columns: dict[str, Any] = {name: values for name, values in arrays.items() if np.ndim(values) == 1}
    clocks: dict[str, str] = {}
    for group, channel in channels:
        if "wf_increment" in channel.properties and len(channel):
            _add_clock(columns, clocks, group, channel.name, _times(channel.properties, len(channel), zero))
    units = dict.fromkeys(clocks.values(), "s")
    units |= {f"{group}/{c.name}": str(c.properties.get("unit_string") or "") for group, c in channels}
    return grouped(path, columns, {name: unit for name, unit in units.items() if unit}, clocks)


def _times(properties: Any, samples: int, zero: Any) -> np.ndarray[Any, Any]:
    start = properties.get("wf_start_time")
    late = 0.0 if start is None or zero is None else float((start - zero) / np.timedelta64(1, "ns")) * 1e-9
    offset = float(properties.get("wf_start_offset", 0.0))
    return late + offset + float(properties["wf_increment"]) * np.arange(samples)


def _add_clock(
    columns: dict[str, Any], clocks: dict[str, str], group: str, channel: str, times: np.ndarray[Any, Any]
) -> None:
    """Note the clock of a waveform: that of its group, or its own where it has another."""
    name = f"{group}/{CLOCK}"
    if name in columns and not np.array_equal(columns[name], times):
        name = f"{group}/{channel} {CLOCK}"
    columns[name] = times
    clocks[f"{group}/{channel}"] = clocks[name] = name
