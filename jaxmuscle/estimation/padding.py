"""Recordings padded to one shape, so that one compilation serves all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from jaxmuscle.estimation.stations import Station
from jaxmuscle.fitting.buckets import longer, padded

MOST_PADDING = 1.5
"""Work with all recordings padded to one shape, relative to the work without, up to which they share it."""


def aligned(stations: Sequence[Station]) -> list[Station]:
    """The same recordings padded to one shape, so that they share one compilation; as they are if too unlike.

    Padding repeats the last sample, and its readings have no weight.
    """
    problems = [s.problem for s in stations]
    windows = max(len(p.rows) for p in problems)
    samples = max(p.samples for p in problems)
    rows = max(p.track.command.shape[0] for p in problems)
    total = max(p.total for p in problems)
    own = sum(len(p.rows) * p.samples + p.total for p in problems)
    work = len(problems) * (windows * samples + total)
    if work > MOST_PADDING * own or len({p.substeps for p in problems}) > 1:
        return list(stations)
    breaks = any(p.track.begins is not None for p in problems)
    return [
        dataclasses.replace(
            s,
            problem=padded(
                s.problem, windows=windows, samples=samples, rows=rows, total=total, breaks=breaks
            ),
            spread={name: longer(values, rows) for name, values in s.spread.items()},
        )
        for s in stations
    ]
