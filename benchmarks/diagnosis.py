"""Is the right effect found, and only then? Every recording of a folder whose truth is known, by its card.

The truth (NAME.truth.json beside NAME.csv) is read here, after the diagnosis, for scoring only.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from pathlib import Path
from typing import Any

import jax

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import BY_NAME
from jaxmuscle.errors import InputError

PRACTICE = Path(__file__).parents[2] / "shared" / "recordings" / "practice"


def names(rig: str) -> set[str]:
    """Effects that the catalogue can offer for a rig."""
    return {name for name, effect in BY_NAME.items() if rig in RIGS and RIGS[rig].offers(effect)}


def scored(path: Path) -> dict[str, Any] | None:
    """Diagnose one recording and hold the outcome against its truth; `None` for a rig not yet there."""
    try:
        recording = jm.read(path)
    except InputError as error:
        print(f"{path.name}: left out: {str(error).splitlines()[0]}", file=sys.stderr)
        return None
    found = jm.diagnose(recording)
    truth = json.loads(path.with_suffix(".truth.json").read_text())["effect"]
    effects = [effect.name for effect in found.effects]
    if truth == "none":
        kind, ok = "clean", not effects
    elif truth in names(recording.card.rig):
        kind, ok = "catalogue", effects[:1] == [truth]
    else:
        kind, ok = "outside", not effects
    return {
        "recording": path.stem, "rig": recording.card.rig, "kind": kind, "truth": truth, "found": effects,
        "verdict": found.verdict, "ok": ok,
        "runners_up": [[a.name, round(a.gain, 3), a.told_apart] for a in found.alternatives[:2]],
        "before": {c: round(e.in_noise, 2) for c, e in found.before["held_out"].items()},
        "after": {c: round(e.in_noise, 2) for c, e in found.after["held_out"].items()},
        "seconds": round(found.seconds, 1),
    }  # fmt: skip


def line(row: dict[str, Any]) -> str:
    """One line of the table."""
    columns = ", ".join(f"{c} {row['before'][c]} → {row['after'][c]}" for c in row["before"])
    runners = ", ".join(f"{name} {gain:.2f}" for name, gain, _ in row["runners_up"])
    return (
        f"{row['recording']:8s} {row['rig']:9s} {'ok' if row['ok'] else 'NO':3s} {row['truth']:24s} "
        f"{', '.join(row['found']) or '-':24s} {row['verdict']:14s} {columns}; "
        f"next: {runners or '-'}; {row['seconds']} s"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=PRACTICE)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    parser.add_argument("--only", nargs="*", help="stems of the recordings to take")
    arguments = parser.parse_args()
    paths = sorted(p for p in arguments.folder.glob("*.csv") if p.with_suffix(".truth.json").exists())
    if not paths:
        print(f"no recordings with a truth in {arguments.folder}", file=sys.stderr)
        return 2
    begin, rows = time.perf_counter(), []
    for path in paths:
        if arguments.only and path.stem not in arguments.only:
            continue
        row = scored(path)
        if row is not None:
            rows.append(row)
            print(line(row), flush=True)
        jax.clear_caches()
    counts = {
        kind: [r["ok"] for r in rows if r["kind"] == kind] for kind in ("catalogue", "clean", "outside")
    }
    for kind, oks in counts.items():
        print(f"{kind}: {sum(oks)} of {len(oks)} right")
    if arguments.json:
        print(json.dumps({"benchmark": "diagnosis", "rows": rows, "reached": sum(r["ok"] for r in rows),
                          "of": len(rows), "by_kind": {k: [sum(v), len(v)] for k, v in counts.items()},
                          "machine": platform.processor() or platform.machine(),
                          "seconds": round(time.perf_counter() - begin, 1)}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
