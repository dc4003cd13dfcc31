"""Figures of the last run of `benchmarks/blind.py`, counted from the rows that it left."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from tables import table

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
sys.path.append(str(BENCHMARKS))

import blind  # pyright: ignore[reportMissingImports] # noqa: E402

ROWS = BENCHMARKS / "blind_rows.jsonl"
"""Diagnoses of the recordings that were drawn from successive seeds, a line each."""
FIGURES, SIZES = "<!-- blind figures -->", "<!-- blind sizes -->"


def with_blind_figures(page: str) -> str:
    """A page with tables in place of the marks."""
    if FIGURES not in page and SIZES not in page:
        return page
    rows = list(blind.kept(ROWS).values())
    return page.replace(FIGURES, _figures(rows)).replace(SIZES, _sizes(rows))


def _figures(rows: Sequence[blind.Row]) -> str:
    lines = ((f["figure"], f"{f['count']} of {f['of']}", f"{f['goal']:.0%}") for f in blind.figures(rows))
    heads = ("figure", f"{len(rows)} recordings, seeds from {min(row['seed'] for row in rows)} on", "goal")
    return table(heads, lines)


def _sizes(rows: Sequence[blind.Row]) -> str:
    sizes = blind.found_by_size(rows)
    cells = ((_between(low, high), f"{right} of {of}") for low, high, right, of in sizes)
    return table(("change in noise units", "found first"), cells)


def _between(low: float, high: float) -> str:
    return f"{low:g} to {high:g}" if math.isfinite(high) else f"from {low:g} on"
