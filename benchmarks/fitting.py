"""Can a fit be believed, do bad starts arrive, how fast beside scipy and CasADi, and with fifty parameters?

Recordings of every rig come from the one-page oracles of the tests (plain NumPy, no code shared with the
model); the fits know nothing but them. Five questions, each a part that can be asked for by itself:

    coverage     do the 95 % intervals hold the truth in 90 to 98 % of the repeats?
    starts       do at least 95 % of the starts that are 50 % off reach the best minimum?
    race         seconds to the same cost beside scipy.optimize.least_squares and CasADi, one start and twenty
    effects      every effect's own parameters from starts 30 to 50 % off: are they found?
    hysteresis   weights and thresholds of two muscles, fifty parameters, within 60 s?

    python benchmarks/fitting.py [--only PART] [--rig RIG] [--repeats 100] [--starts 20] [--json]

CasADi (`pip install casadi`) and gcc are needed by the race alone.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

Rows = Iterable[dict[str, Any]]


def coverage(arguments: argparse.Namespace) -> Rows:
    from fitting_believed import believed

    return believed(arguments.repeats, arguments.rig)


def starts(arguments: argparse.Namespace) -> Rows:
    from fitting_believed import arrived

    return arrived(arguments.starts, arguments.rig)


def race(arguments: argparse.Namespace) -> Rows:
    if importlib.util.find_spec("casadi") is None or shutil.which("gcc") is None:
        print("race: left out, it needs casadi (pip install casadi) and gcc", file=sys.stderr)
        return []
    from fitting_race import race

    return race()


def hysteresis(arguments: argparse.Namespace) -> Rows:
    from fitting_hysteresis import fifty

    return [fifty()]


def effects(arguments: argparse.Namespace) -> Rows:
    from fitting_effects import every

    return every()


# The race first: nothing may be compiled before its cold runs.
PARTS: dict[str, Callable[[argparse.Namespace], Rows]] = {
    "race": race,
    "hysteresis": hysteresis,
    "coverage": coverage,
    "starts": starts,
    "effects": effects,
}


def main() -> int:
    """Run all parts, or one, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", choices=PARTS, action="append", help="one part; may be given more than once"
    )
    parser.add_argument(
        "--rig", action="append", help="of coverage and starts one rig; may be given more than once"
    )
    parser.add_argument("--repeats", type=int, default=100, help="recordings of each rig for the coverage")
    parser.add_argument("--starts", type=int, default=20, help="starts of each rig that are 50 %% off")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows = time.perf_counter(), []
    for name in arguments.only or PARTS:
        for row in PARTS[name](arguments):
            rows.append(row)
            line = f"{'ok  ' if row['ok'] else 'MISS'} {row['figure']:64s} {row['ours']:8.3g}"
            print(f"{line}   goal: {row['goal']}", flush=True)
            if "told" in row:
                print(f"       {row['told']}")
            if "why" in row:
                print(f"       {row['why']}")
            if isinstance(row.get("seconds"), dict):
                print("       " + ", ".join(f"{who} {value:.3g} s" for who, value in row["seconds"].items()))
    if arguments.json:
        summary = {
            "benchmark": "fitting",
            "rows": rows,
            "reached": sum(row["ok"] for row in rows),
            "of": len(rows),
            "machine": platform.processor() or platform.machine(),
            "seconds": time.perf_counter() - begin,
        }
        print(json.dumps(summary))
    return 0


if __name__ == "__main__":
    sys.exit(main())
