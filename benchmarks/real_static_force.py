"""How well is the force of a measured muscle predicted at lengths, and for muscles, that no fit has seen?

Protocol A: fit on three lengths of a muscle, predict the fourth; pooled over the four. Protocol B: fit on
three other muscles of the same make (83, 132 and 281 mm), predict the whole muscle. Errors are over the
settled points of the valve schedule with a taut muscle. The published figures are the makers' empirical law
(fitted to all these muscles) and two published models.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from typing import Any

import numpy as np
import psu_isometric as psu

from jaxmuscle.diagnosis import Diagnosis, diagnose

MUSCLES = {"25": "233 mm", "27": "257 mm"}
PUBLISHED = {"25": (16.8, 62.6, 132.7), "27": (22.9, 73.8, 143.8)}
GOALS = {"25": 25.0, "27": 30.0}
OTHERS = ("10", "15", "30")


def settled_errors(found: Diagnosis, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the declared and of the final model at the given rows [N]."""
    measured = found.recording.columns["force"][rows]
    before, after = found.traces.before["force"][rows], found.traces.after["force"][rows]
    return np.maximum(before, 0) - measured, np.maximum(after, 0) - measured


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def summary(found: Diagnosis) -> dict[str, Any]:
    fitted = {n: [p.value, p.std, p.unit] for n, p in found.parameters.items()}
    return {"effects": [effect.name for effect in found.effects], "parameters": fitted}


def lengths_left_out(root: Any, muscle: str, say: Any) -> dict[str, Any]:
    data = psu.held(root, (muscle,), psu.RESTING[muscle])
    before, after, folds = [], [], []
    for number in range(4):
        out = data.length == number
        found = diagnose(data.recording, held_out=out, ignored=data.slack)
        one, two = settled_errors(found, out & data.settled)
        say(
            f"  {MUSCLES[muscle]}, length {number} left out: {rms(one):.1f} -> {rms(two):.1f} N, "
            f"{summary(found)['effects']}"
        )
        before.append(one)
        after.append(two)
        folds.append(
            {
                "length_mm": 1e3 * psu.LENGTHS[muscle][number],
                "before": rms(one),
                "after": rms(two),
                **summary(found),
            }
        )
    return {"before": rms(np.concatenate(before)), "after": rms(np.concatenate(after)), "folds": folds}


def muscles_left_out(root: Any, say: Any) -> dict[str, dict[str, Any]]:
    data = psu.held(root, (*OTHERS, *MUSCLES), psu.RESTING["25"])
    found = diagnose(data.recording, held_out=~np.isin(data.muscle, OTHERS), ignored=data.slack)
    result = {}
    for muscle in MUSCLES:
        one, two = settled_errors(found, (data.muscle == muscle) & data.settled)
        say(
            f"  {MUSCLES[muscle]} from other muscles: {rms(one):.1f} -> {rms(two):.1f} N, "
            f"{summary(found)['effects']}"
        )
        result[muscle] = {"before": rms(one), "after": rms(two), **summary(found)}
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    root = psu.folder()
    if root is None:
        print("the measured data are not here: name their folder in JAXMUSCLE_DATA", file=sys.stderr)
        return 2
    begin, rows = time.perf_counter(), []

    def say(text: str) -> None:
        print(text, flush=True)

    other = muscles_left_out(root, say)
    for muscle, name in MUSCLES.items():
        for protocol, outcome in (("A", lengths_left_out(root, muscle, say)), ("B", other[muscle])):
            empirical, better, worse = PUBLISHED[muscle]
            ok = outcome["after"] <= GOALS[muscle]
            rows.append(
                {
                    "figure": f"{name}, protocol {protocol}",
                    "goal": GOALS[muscle],
                    "ours": outcome["after"],
                    "ok": ok,
                    "published": [empirical, better, worse],
                    **outcome,
                }
            )
    print(f"\n{'held out':24s} {'before':>8s} {'after':>8s} {'goal':>6s}   published (empirical, two models)")
    for row in rows:
        print(
            f"{row['figure']:24s} {row['before']:8.1f} {row['after']:8.1f} {row['goal']:6.0f}   "
            f"{row['published']}"
        )
    if arguments.json:
        reached = sum(row["ok"] for row in rows)
        print(json.dumps({"benchmark": "real_static_force", "rows": rows, "reached": reached, "of": len(rows),
                          "machine": platform.processor() or platform.machine(),
                          "seconds": time.perf_counter() - begin}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
