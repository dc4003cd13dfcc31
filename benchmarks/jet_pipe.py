"""Does the package give the numbers that [H] published for the jet-pipe actuator? A row for each."""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable, Iterator

from jet_pipe_bandwidth import bandwidth_rows, response_rows
from jet_pipe_identification import identification_rows
from jet_pipe_point import gain_rows, pole_rows
from jet_pipe_rows import Row, line

PARTS: tuple[Callable[[], Iterator[Row]], ...] = (
    *(pole_rows, gain_rows, bandwidth_rows, response_rows, identification_rows),
)


def rows() -> Iterator[Row]:
    """All rows."""
    for part in PARTS:
        yield from part()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, found = time.perf_counter(), []
    for entry in rows():
        found.append(entry)
        print(line(entry), flush=True)
    reached = sum(entry["ok"] for entry in found)
    print(f"{reached} of {len(found)}")
    if arguments.json:
        print(json.dumps({"benchmark": "jet_pipe", "rows": found, "reached": reached, "of": len(found),
                          "machine": platform.processor() or platform.machine(),
                          "seconds": round(time.perf_counter() - begin, 1)}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
