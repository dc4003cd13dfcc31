"""How a row of a table of published values is written, and the end that all such tables have.

Counted is a number that a source prints, compared with the experiment that the source describes. Everything
else is shown and not counted: checks of our own, statements in words, other readings of the source.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

Row = dict[str, Any]
Sections = Mapping[str, Callable[[], Iterable[Row]]]
"""Name of a part of a benchmark → its rows."""

OWN, OTHER, WORDS, SEEN = "own check", "another reading", "in words", "seen data"
"""Why a row is shown and not counted. OWN: the number is derived, follows from what was put in, or belongs to
another experiment than that of the source. OTHER: it is published, and counted under the reading of the
source that the benchmark declares. WORDS: the source says it without a number, so the limit is ours. SEEN:
the data were fitted, or the prediction is told what comes.
"""
DIGITS = "half of the last digit"
NOT_UNDERSTOOD = "not understood"
SLACK = 1e-9
"""Of a tolerance: rounding of decimal fractions must not decide."""


def half_digit(printed: str) -> float:
    """Half a unit in the last place of a number as it is printed: 0.05 for "-14.5", 0.5 for "1084".

    Raises:
        ValueError: `printed` is no number.
    """
    float(printed)
    mantissa, _, exponent = printed.lower().partition("e")
    return 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def aside(entry: Row, what: str) -> Row:
    """A row that is not counted among what is reached: :data:`OWN`, :data:`OTHER` or :data:`WORDS`."""
    return {**entry, "aside": what}


def assuming(entry: Row, what: str) -> Row:
    """A row on which a number has a say that the source does not give and this benchmark chose."""
    return {**entry, "free": what}


def under(reading: str, rows: Iterable[Row]) -> Iterator[Row]:
    """Rows that say under which reading of their source they were made, unless they do already."""
    for entry in rows:
        yield {**entry, "reading": entry.get("reading", reading)}


def row(
    source: str, figure: str, goal: str, ours: float | list[float], ok: bool,
    unit: str = "", tolerance: str = "", reason: str = "", why: str = "",
) -> Row:  # fmt: skip
    """One line of the table; what is missed keeps its place and says why."""
    entry = {"source": source, "figure": figure, "goal": goal, "ours": ours, "unit": unit,
             "tolerance": tolerance, "reason": reason, "ok": bool(ok)}  # fmt: skip
    return entry if ok else {**entry, "why": why or NOT_UNDERSTOOD}


def near(
    source: str, figure: str, goal: float, ours: float, unit: str, share: float, reason: str, why: str = "",
) -> Row:  # fmt: skip
    """A row that asks for a relative deviation of at most `share`."""
    ok = abs(ours - goal) <= share * abs(goal) * (1 + SLACK)
    return row(source, figure, f"{goal:g}", ours, ok, unit, f"{share:.3g} relative", reason, why)


def as_printed(source: str, figure: str, goal: str, ours: float, unit: str = "", why: str = "") -> Row:
    """A row that asks for a printed number to half a unit of its last digit."""
    allowed = half_digit(goal)
    ok = abs(ours - float(goal)) <= allowed * (1 + SLACK)
    return row(source, figure, goal, ours, ok, unit, f"{allowed:g}", DIGITS, why)


def at_most(
    source: str, figure: str, goal: str, ours: float, unit: str = "", reason: str = "", why: str = "",
    allowed: float = 0.0,
) -> Row:  # fmt: skip
    """A row that asks for no more than a printed error, and what its last digit allows beyond it."""
    ok = ours <= float(goal) + allowed * (1 + SLACK)
    tolerance = f"{allowed:g} more" if allowed else "not more"
    return row(source, figure, goal, ours, ok, unit, tolerance, reason, why)


def shown(value: object) -> str:
    """A number, or several, in four digits."""
    return ", ".join(f"{v:.4g}" for v in value) if isinstance(value, list) else f"{value:.4g}"


def line(entry: Row) -> str:
    """A row as text."""
    ours = f"{shown(entry['ours'])} {entry['unit']}".rstrip()
    mark = "ok" if entry["ok"] else "NO"
    kind = f"({entry['aside']}) " if "aside" in entry else ""
    said = "goal" if entry.get("aside") == OWN else "published"
    text = f"{mark:3s}{kind}{entry['source']}: {entry['figure']}: {ours}; {said} {entry['goal']}"
    if entry["tolerance"]:
        text += f" (to {entry['tolerance']}: {entry['reason']})"
    text += f" [{entry['reading']}]" if "reading" in entry else ""
    text += f"\n     chosen here: {entry['free']}" if "free" in entry else ""
    return text + (f"\n     {entry['why']}" if "why" in entry else "")


def finite(value: Any) -> Any:
    """A row, or a number of it, as JSON can say it: `None` for what is not finite."""
    if isinstance(value, dict):
        return {name: finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def counts(found: list[Row]) -> dict[str, Any]:
    """How many published numbers are reached, of how many; how many of them rest on a number chosen here;
    beside them the rows that do not count.
    """

    def of(rows: list[Row]) -> dict[str, int]:
        return {"reached": sum(bool(entry["ok"]) for entry in rows), "of": len(rows)}

    counted = [entry for entry in found if "aside" not in entry]
    kinds = sorted({entry["aside"] for entry in found if "aside" in entry})
    beside = {kind: of([entry for entry in found if entry.get("aside") == kind]) for kind in kinds}
    return {**of(counted), "chosen": of([entry for entry in counted if "free" in entry]), "aside": beside}


def printed(benchmark: str, about: str | None, rows: Callable[[], Iterable[Row]] | Sections) -> int:
    """Print the rows as they come, how many are reached and, with ``--json``, all in one line.

    Of sections ``--only`` takes some, and each ends with the CPU seconds that it took.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    sections = rows if isinstance(rows, Mapping) else {}
    if sections:
        parser.add_argument("--only", nargs="+", choices=list(sections), default=list(sections))
    arguments = parser.parse_args()
    parts = {name: sections[name] for name in arguments.only} if isinstance(rows, Mapping) else {"": rows}
    begin, found, spent = time.perf_counter(), [], {}
    for name, part in parts.items():
        before = time.process_time()
        for entry in part():
            found.append(entry)
            print(line(entry), flush=True)
        if name:
            spent[name] = round(time.process_time() - before, 1)
            print(f"section {name}: {spent[name]:g} CPU s", flush=True)
    counted = counts(found)
    chosen = counted["chosen"]
    print(f"{counted['reached']} of {counted['of']}")
    if chosen["of"]:
        print(f"of these, with a number that the source does not give: {chosen['reached']} of {chosen['of']}")
    for kind, share in counted["aside"].items():
        print(f"not counted, {kind}: {share['reached']} of {share['of']}")
    if arguments.json:
        table = {"benchmark": benchmark, "rows": found, **counted,
                 "machine": platform.processor() or platform.machine(),
                 "seconds": round(time.perf_counter() - begin, 1),
                 **({"cpu_seconds": spent} if spent else {})}  # fmt: skip
        print(json.dumps(finite(table), allow_nan=False))
    return 0
