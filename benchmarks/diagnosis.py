"""Is the right effect found, and only then? Every recording of a folder whose truth is known, by its card.

Scored are the effect that was added first, the verdict ("complete" where nothing is missing, "unexplained"
where the cause is outside the rig's catalogue, else "effects found"), and effects added that are not there.
The truth (NAME.truth.json beside NAME.csv) is read here, after the diagnosis, for scoring only.

With `--profile` tables tell instead where the time of each diagnosis goes: the sample `lift` alone unless
recordings are asked for by `--only`.
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
from diagnosis_profile import profiled, written
from diagnosis_score import VERDICTS, score, totals

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import BY_NAME
from jaxmuscle.effects.readings import KINDS
from jaxmuscle.errors import InputError

PRACTICE = Path(__file__).parents[2] / "shared" / "recordings" / "practice"


def names(rig: str) -> set[str]:
    """Effects that a diagnosis of a rig may find, errors of its sensors by their kind."""
    offered = {name for name, effect in BY_NAME.items() if rig in RIGS and RIGS[rig].offers(effect)}
    return offered | {*KINDS}


def scored(path: Path) -> dict[str, Any] | None:
    """Diagnose one recording and hold the outcome against its truth; `None` for a rig not yet there."""
    try:
        recording = jm.read(path)
    except InputError as error:
        print(f"{path.name}: left out: {str(error).splitlines()[0]}", file=sys.stderr)
        return None
    found = jm.diagnose(recording)
    truth = json.loads(path.with_suffix(".truth.json").read_text())["effect"]
    effects, rig = [effect.kind for effect in found.effects], recording.card.rig
    return {
        "figure": f"{path.stem}: effect and verdict right, nothing added falsely", "recording": path.stem,
        "rig": rig, **score(truth, effects, found.verdict, names(rig)), "ours": found.verdict,
        "runners_up": [[a.name, round(a.gain, 3), a.told_apart] for a in found.alternatives[:2]],
        "before": {c: round(e.in_noise, 2) for c, e in found.before["held_out"].items()},
        "after": {c: round(e.in_noise, 2) for c, e in found.after["held_out"].items()},
        "seconds": round(found.seconds, 1),
    }  # fmt: skip


def line(row: dict[str, Any]) -> str:
    """One line of the table."""
    columns = ", ".join(f"{c} {row['before'][c]} → {row['after'][c]}" for c in row["before"])
    runners = ", ".join(f"{name} {gain:.2f}" for name, gain, _ in row["runners_up"])
    verdict = row["verdict"] if row["verdict_ok"] else f"{row['verdict']}, NOT {row['goal']}"
    false = f"added falsely: {', '.join(row['false_additions'])}; " if row["false_additions"] else ""
    return (
        f"{row['recording']:8s} {row['rig']:9s} {'ok' if row['ok'] else 'NO':3s} {row['truth']:24s} "
        f"{', '.join(row['found']) or '-':24s} {verdict:14s} {false}{columns}; "
        f"next: {runners or '-'}; {row['seconds']} s"
    )


def profiles(paths: list[Path]) -> int:
    """Print where the time of a diagnosis goes, from nothing compiled, recording after recording."""
    for path in paths:
        jax.clear_caches()
        profile, _ = profiled(path)
        print(written(path.stem, profile), end="\n\n", flush=True)
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=PRACTICE)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    parser.add_argument("--only", nargs="*", help="stems of the recordings to take")
    parser.add_argument("--profile", action="store_true", help="where the time goes, in tables; no score")
    arguments = parser.parse_args()
    if arguments.profile:
        stems = arguments.only or []
        return profiles([arguments.folder / f"{stem}.csv" for stem in stems] or [jm.sample("lift")])
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
    counts = totals(rows)
    for kind, goal in VERDICTS.items():
        (effects, of), (verdicts, _) = counts["effects"][kind], counts["verdicts"][kind]
        print(f"{kind}: effect right in {effects} of {of}, verdict ({goal}) in {verdicts} of {of}")
    false = counts["false_additions"]
    print(f"effects added that are not there: {false['effects']}, in {false['recordings']} of {len(rows)} "
          "recordings")  # fmt: skip
    print(f"right in every respect: {counts['reached']} of {counts['of']}")
    if arguments.json:
        print(json.dumps({"benchmark": "diagnosis", "rows": rows, **counts,
                          "machine": platform.processor() or platform.machine(),
                          "seconds": round(time.perf_counter() - begin, 1)}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
