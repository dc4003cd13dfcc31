"""How fast beside SciPy, CasADi with CVODES, plain diffrax and hand-written C, at equal accuracy?

All integrate the one-muscle model of `peers_model.py` over 2 s at 500 Hz, each with the loosest setting that
keeps the position within 1e-4 of a reference that is exact to 1e-10. Needs casadi and numba, and for the
limit a C compiler.

    python benchmarks/peers.py [--only single batch c slopes compile points dask] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time

from peers_sections import CORES, SECTIONS
from peers_settings import Peers


def main() -> None:
    """Run the sections and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS), help="sections to run")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows, peers = time.perf_counter(), [], Peers()
    for name in arguments.only:
        for line in SECTIONS[name](peers):
            rows.append(line)
            told = f"   why: {line['why']}" if "why" in line else ""
            figures = f"{line['figure']:<52} {line['ours']:.3g}   goal: {line['goal']}"
            print(f"{'ok  ' if line['ok'] else 'MISS'} {figures}{told}", flush=True)
    if arguments.json:
        summary = {
            "benchmark": "peers", "rows": rows, "reached": sum(line["ok"] for line in rows), "of": len(rows),
            "accuracy": peers.accuracy, "cores": CORES, "machine": platform.processor() or platform.machine(),
            "load": os.getloadavg(), "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        print(json.dumps(summary))


if __name__ == "__main__":
    # Workers of a cluster begin by importing this file.
    main()
