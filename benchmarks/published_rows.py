"""How a row of a table of published values is written, and the end that all such tables have."""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Callable, Iterable
from typing import Any

Row = dict[str, Any]


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
    text = f"{mark:3s}{entry['source']}: {entry['quantity']}: {ours}; published {entry['published']}"
    if entry["tolerance"]:
        text += f" (to {entry['tolerance']}: {entry['reason']})"
    return text + (f"\n     {entry['why']}" if "why" in entry else "")


def printed(benchmark: str, about: str | None, rows: Callable[[], Iterable[Row]], text: Any = line) -> int:
    """Print the rows as they come, how many are reached and, with ``--json``, all in one line."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, found = time.perf_counter(), []
    for entry in rows():
        found.append(entry)
        print(text(entry), flush=True)
    reached = sum(bool(entry["ok"]) for entry in found)
    print(f"{reached} of {len(found)}")
    if arguments.json:
        print(json.dumps({"benchmark": benchmark, "rows": found, "reached": reached, "of": len(found),
                          "machine": platform.processor() or platform.machine(),
                          "seconds": round(time.perf_counter() - begin, 1)}))  # fmt: skip
    return 0
