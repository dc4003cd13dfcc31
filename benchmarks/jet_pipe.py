"""Does the package give the numbers that [H] published for the jet-pipe actuator? A row for each."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from jet_pipe_bandwidth import bandwidth_rows, response_rows
from jet_pipe_identification import identification_rows
from jet_pipe_point import gain_rows, pole_rows
from jet_pipe_reading import reading_rows
from jet_pipe_rows import GAUGE
from published_rows import Row, printed, under

PARTS: tuple[Callable[[], Iterator[Row]], ...] = (
    *(pole_rows, gain_rows, bandwidth_rows, response_rows, reading_rows, identification_rows),
)


def rows() -> Iterator[Row]:
    """All rows, each with the reading of [H] that it is under."""
    for part in PARTS:
        yield from under(GAUGE, part())


if __name__ == "__main__":
    sys.exit(printed("jet_pipe", __doc__, rows))
