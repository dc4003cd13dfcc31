"""What windows are fitted as before they are whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jaxmuscle.estimation.stations import Station, in_parts, widened

PARTS = (40, 16, 4)
"""Parts of a window on which starts are brought down first, one after the other.

In a fortieth of a window an error has little time to grow: the cost is nearly that of the accelerations,
which has hardly a minimum but one. Each longer part is begun within reach of its minimum.
"""
SHORTEST_PART = 4
"""Samples in a part at least."""


def stages(
    stations: Sequence[Station], continuation: Sequence[float]
) -> Iterator[tuple[str, Sequence[Station]]]:
    """Name and windows of each stage: in ever longer parts, or with ever drier friction."""
    shortest = min(station.period for station in stations)
    for factor in continuation:
        name = f"friction {factor:g} times as wide"
        yield name, widened(in_parts(stations, PARTS[-1]), factor)
    for many in PARTS[:-1] if not continuation else ():
        if shortest >= SHORTEST_PART * many:
            yield f"windows in {many} parts", in_parts(stations, many)
    yield f"windows in {PARTS[-1]} parts", in_parts(stations, PARTS[-1])
