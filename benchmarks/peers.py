"""How fast beside CasADi, SciPy, numbalsoda, plain diffrax and hand-written C, at equal accuracy?

All integrate the one-muscle model of `peers_model.py` over 2 s at 500 Hz, each with the fastest of nine
settings that keeps the position within 1e-4 of a reference that is exact to 1e-10, batches on all cores.
CasADi is taken at its best of fixed steps, compiled as C, and CVODES. Needs casadi and numba; the rows
against CasADi and C need a C compiler, numbalsoda is tried where it is installed.

    python benchmarks/peers.py [--only single batch c slopes compile points dask] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from typing import Any

from peers_sections import SECTIONS
from peers_settings import CORES, Peers


def told(line: dict[str, Any]) -> None:
    """Print a row, and what was measured for it."""
    if "skipped" in line:
        print(f"skip {line['figure']:<64}   not counted: {line['skipped']}", flush=True)
        return
    why = f"   why: {line['why']}" if line.get("why") else ""
    reached = f"{line['figure']:<64} {line['ours']:.3g}"
    print(f"{'ok  ' if line['ok'] else 'MISS'} {reached}   goal: {line['goal']}{why}")
    for unit in ("ms", "us a run"):
        if unit in line:
            print("       " + ", ".join(f"{who} {took:.3g}" for who, took in line[unit].items()) + f" {unit}")
    sys.stdout.flush()


def main() -> None:
    """Run the sections and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS), help="sections to run")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows = time.perf_counter(), []
    with Peers() as peers:
        for name in arguments.only:
            for line in SECTIONS[name](peers):
                rows.append(line)
                told(line)
    counted = [line for line in rows if "skipped" not in line]
    if arguments.json:
        summary = {
            "benchmark": "peers", "rows": rows, "reached": sum(line["ok"] for line in counted),
            "of": len(counted),
            "accuracy": peers.accuracy, "cores": CORES, "machine": platform.processor() or platform.machine(),
            "load": os.getloadavg(), "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        print(json.dumps(summary))


if __name__ == "__main__":
    # Workers of a cluster begin by importing this file.
    main()
