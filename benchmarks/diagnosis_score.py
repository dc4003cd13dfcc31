"""How a diagnosis is held against the truth of its recording: effects, verdict, what was added falsely."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

NOTHING = "none"
"""The truth of a recording that lacks nothing."""
VERDICTS = {"clean": "complete", "catalogue": "effects found", "outside": "unexplained"}
"""Kind of recording → the verdict that is right: nothing is missing; what is missing is in the catalogue of
the rig; it is not.
"""


def kind_of(truth: str, offered: Collection[str]) -> str:
    """The kind of a recording, a key of :data:`VERDICTS`, by its truth and the effects offered to its rig."""
    if truth == NOTHING:
        return "clean"
    return "catalogue" if truth in offered else "outside"


def score(truth: str, found: Sequence[str], verdict: str, offered: Collection[str]) -> dict[str, Any]:
    """Hold the effects found, in the order of adding, and the verdict against the truth.

    `effect_ok`: the true effect was added first; nothing was, where nothing in the catalogue is true.
    `false_additions`: effects that were added and are not there. `ok`: effect and verdict right, and nothing
    added falsely.
    """
    kind = kind_of(truth, offered)
    false = [name for name in found if name != truth]
    effect_ok = list(found[:1]) == [truth] if kind == "catalogue" else not found
    verdict_ok = verdict == VERDICTS[kind]
    return {
        "kind": kind, "truth": truth, "found": list(found), "verdict": verdict, "goal": VERDICTS[kind],
        "effect_ok": effect_ok, "verdict_ok": verdict_ok, "false_additions": false,
        "ok": effect_ok and verdict_ok and not false,
    }  # fmt: skip


def totals(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Counts over scored recordings: right in every respect, by effect, by verdict; false additions."""
    rows = list(rows)

    def of(name: str, some: list[dict[str, Any]]) -> list[int]:
        return [sum(bool(row[name]) for row in some), len(some)]

    kinds = {kind: [row for row in rows if row["kind"] == kind] for kind in VERDICTS}
    return {
        "reached": of("ok", rows)[0],
        "of": len(rows),
        "effects": {kind: of("effect_ok", some) for kind, some in kinds.items()},
        "verdicts": {kind: of("verdict_ok", some) for kind, some in kinds.items()},
        "false_additions": {
            "effects": sum(len(row["false_additions"]) for row in rows),
            "recordings": sum(bool(row["false_additions"]) for row in rows),
        },
    }
