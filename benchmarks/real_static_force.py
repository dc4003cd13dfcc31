"""How well is the force of a measured muscle predicted at lengths, and for muscles, that no fit has seen?

Protocol A: fit on three lengths of a muscle, predict the fourth; pooled over the four. Protocol B: fit on
three other muscles of the same make (83, 132 and 281 mm), predict the whole muscle. Errors are over the
settled points of the valve schedule with a taut muscle. The goal is the published error of the makers'
empirical law, which was fitted to muscles of this make; beside it stand two published models, and the law
evaluated on the very points that are judged here.
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
from measured_rows import extrapolated, static_force
from published_rows import counts, finite

from jaxmuscle.diagnosis import Diagnosis, diagnose

MUSCLES = {"25": "233 mm", "27": "257 mm"}
PUBLISHED = {"25": (16.8, 62.6, 132.7), "27": (22.9, 73.8, 143.8)}
"""Errors [N] of the makers' law and of two models: Bolen et al. 2026."""
PROTOCOLS = {"A": "length left out", "B": "other muscles"}
LENGTH = (
    "the full force of the makers' law depends on the length of the muscle, 292 N of one of 83 mm and 419 N "
    "of one of 281 mm; here it does only as far as all are longer at rest than said"
)
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
    data = psu.held(root, (muscle,))
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
    data = psu.held(root, (*OTHERS, *MUSCLES))
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


def by_the_makers(root: Any, muscle: str) -> dict[str, float]:
    """Error of the makers' law on the same settled points: pressures as read, and less the sensor's zero."""
    data = psu.held(root, (muscle,))
    length = np.array(psu.LENGTHS[muscle])[data.length]
    gauge, measured = data.recording.columns["pressure"] - psu.AMBIENT, data.recording.columns["force"]
    return {
        name: rms((psu.makers_force(muscle, length, gauge + zero) - measured)[data.settled])
        for name, zero in (("pressure as read", psu.PRESSURE_ZERO), ("zero corrected", 0.0))
    }


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
    for muscle in MUSCLES:
        law = by_the_makers(root, muscle)
        say(f"  {MUSCLES[muscle]}, makers' law on the same points: "
            + ", ".join(f"{error:.1f} N ({name})" for name, error in law.items()))  # fmt: skip
        for protocol, outcome in (("A", lengths_left_out(root, muscle, say)), ("B", other[muscle])):
            figure = f"{MUSCLES[muscle]}, protocol {protocol}: {PROTOCOLS[protocol]}"
            goal, *models = PUBLISHED[muscle]
            why = extrapolated(outcome["folds"]) if protocol == "A" else LENGTH
            entry = static_force(figure, f"{goal}", outcome["after"], law, why)
            rows.append({**entry, "published": [goal, *models], **outcome})
    print(f"\n{'held out':42s} {'before':>8s} {'after':>8s} {'goal':>6s}   published (law, two models)")
    for entry in rows:
        mark = "ok" if entry["ok"] else "NO"
        print(f"{mark} {entry['figure']:39s} {entry['before']:8.1f} {entry['after']:8.1f} "
              f"{entry['goal']:>6s}   {entry['published']}")  # fmt: skip
        if "why" in entry:
            print(f"     {entry['why']}")
    counted = counts(rows)
    print(f"{counted['reached']} of {counted['of']}")
    if arguments.json:
        table = {"benchmark": "real_static_force", "rows": rows, **counted,
                 "machine": platform.processor() or platform.machine(),
                 "seconds": time.perf_counter() - begin}  # fmt: skip
        print(json.dumps(finite(table), allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
