"""How a row of a table of published values is written, and the end that all such tables have."""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

Row = dict[str, Any]

OWN, OTHER = "own check", "another reading"
"""Why a row is shown and not counted: nobody published its number; it is published, and counted under the
reading of the source that the benchmark declares.
"""


def aside(entry: Row, what: str) -> Row:
    """A row that is not counted among what is reached: :data:`OWN` or :data:`OTHER`."""
    return {**entry, "aside": what}


def under(reading: str, rows: Iterable[Row]) -> Iterator[Row]:
    """Rows that say under which reading of their source they were made, unless they do already."""
    for entry in rows:
        yield {**entry, "reading": entry.get("reading", reading)}


def row(
    source: str, quantity: str, published: str, ours: float | list[float], ok: bool,
    unit: str = "", tolerance: str = "", reason: str = "", why: str = "",
) -> Row:  # fmt: skip
    """One line of the table; what differs keeps its place and says why."""
    entry = {"source": source, "quantity": quantity, "published": published, "ours": ours, "unit": unit,
             "tolerance": tolerance, "reason": reason, "ok": bool(ok)}  # fmt: skip
    return {**entry, "why": why} if why else entry


def near(
    source: str, quantity: str, published: float, ours: float, unit: str, share: float, reason: str,
    why: str = "",
) -> Row:  # fmt: skip
    """A row that asks for a relative deviation of at most `share`."""
    ok = abs(ours - published) <= share * abs(published)
    return row(
        source, quantity, f"{published:g}", ours, ok, unit, f"{share:.3g} relative", reason, "" if ok else why
    )


def shown(value: object) -> str:
    """A number, or several, in four digits."""
    return ", ".join(f"{v:.4g}" for v in value) if isinstance(value, list) else f"{value:.4g}"


def line(entry: Row) -> str:
    """A row as text."""
    ours = f"{shown(entry['ours'])} {entry['unit']}".rstrip()
    mark = "ok" if entry["ok"] else "NO"
    kind = f"({entry['aside']}) " if "aside" in entry else ""
    text = f"{mark:3s}{kind}{entry['source']}: {entry['quantity']}: {ours}; published {entry['published']}"
    if entry["tolerance"]:
        text += f" (to {entry['tolerance']}: {entry['reason']})"
    text += f" [{entry['reading']}]" if "reading" in entry else ""
    return text + (f"\n     {entry['why']}" if "why" in entry else "")


def finite(value: Any) -> Any:
    """A row, or a number of it, as JSON can say it: `None` for what is not finite."""
    if isinstance(value, dict):
        return {name: finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def counts(found: list[Row]) -> dict[str, Any]:
    """How many published numbers are reached, of how many; beside them the rows that do not count."""

    def of(rows: list[Row]) -> dict[str, int]:
        return {"reached": sum(bool(entry["ok"]) for entry in rows), "of": len(rows)}

    kinds = sorted({entry["aside"] for entry in found if "aside" in entry})
    beside = {kind: of([entry for entry in found if entry.get("aside") == kind]) for kind in kinds}
    return {**of([entry for entry in found if "aside" not in entry]), "aside": beside}


def printed(benchmark: str, about: str | None, rows: Callable[[], Iterable[Row]], text: Any = line) -> int:
    """Print the rows as they come, how many are reached and, with ``--json``, all in one line."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, found = time.perf_counter(), []
    for entry in rows():
        found.append(entry)
        print(text(entry), flush=True)
    counted = counts(found)
    print(f"{counted['reached']} of {counted['of']}")
    for kind, share in counted["aside"].items():
        print(f"not counted, {kind}: {share['reached']} of {share['of']}")
    if arguments.json:
        table = {"benchmark": benchmark, "rows": found, **counted,
                 "machine": platform.processor() or platform.machine(),
                 "seconds": round(time.perf_counter() - begin, 1)}  # fmt: skip
        print(json.dumps(finite(table), allow_nan=False))
    return 0
