"""Every readable published quantity of the three source systems beside ours: one table.

[T] by `tondu.py`, [H] by `jet_pipe.py`, [W] by `hysteresis.py`, the controllers of all three by
`closed_loop.py`: their rows, with source and tolerance. Checks of our own, and numbers under another reading
of the source than the declared one, are shown and not counted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import closed_loop
import hysteresis
import jax
import jet_pipe
import tondu
from hysteresis_loops import loops
from published_rows import OWN, Row, aside, printed

TONDU = (
    ("largest force", "[T] 5", "1.3 N", "a and b were rounded to four digits"),
    ("force of a 50 g", "[T] 5 and text", "above", "a bound"),
    ("largest contraction", "[T] 5, 7", "5e-4", "the digits that are printed"),
    ("contact surface", "[T] 13, 14", "0.01", "'about'"),
    ("Schulte", "[T] 6", "1e-13", "identical up to rounding"),
    ("isotonic contraction", "[T] 18", "0.1 to 1 s", "in words"),
    ("contraction,", "[T] 18", "below 0.05", "in words"),
    ("largest torque", "[T] text to 19", "0.3 N m", "'about'"),
    ("joint range", "[T] text to 19", "0.1 rad", "the digits that are printed"),
    ("K3", "[T] 19", "0.01", "'about'"),
    ("joint 1", "[T] open loop", "0.05", "identified as second order, no number legible"),
    ("joint 2", "[T] open loop", "0.05", "identified as second order, no number legible"),
    ("damping ratios", "[T] open loop", "sign", "in words"),
    ("mass of link", "[T] robot", "0.3 kg", "a scanned digit"),
    ("feedforward", "[T] Cartesian tracking", "not more", "a bound that was measured"),
)
"""Beginning of a figure's name → where it was published, tolerance and its reason."""


def tondu_rows() -> Iterator[Row]:
    for part in tondu.PARTS:
        for entry in part():
            name = str(entry["figure"])
            known = next((found for found in TONDU if name.startswith(found[0])), None)
            source, tolerance, reason = known[1:] if known else ("[T]", "as its benchmark", "see tondu.py")
            yield described(entry, source, tolerance, reason, str(entry["goal"]))


def hysteresis_rows() -> Iterator[Row]:
    def quiet(_: str) -> None:
        """Its own tables are left to its own benchmark."""

    made = tuple(f"{loop.name}:" for loop in loops() if loop.maker is not None)
    for entry in hysteresis.loop_rows(quiet):
        goal = f"{entry['published']:.4g}"
        here = described(entry, "[W] section 2", f"at most {entry['goal']:g}", "measured loops there", goal)
        # A loop that such a model made itself is found again, which says nothing of measured ones.
        yield aside(here, OWN) if str(entry["figure"]).startswith(made) else here
    jax.clear_caches()
    for entry in hysteresis.minor_rows(quiet):
        why = "[H] found Frame's rule no better than the mid-line; play operators should be several times"
        tolerance = f"at least {entry['goal']:g}"
        yield aside(described(entry, "[H] 3.2.2", tolerance, why, "not predicted"), OWN)
    jax.clear_caches()
    for entry in hysteresis.compensation.rows(quiet):
        goal = f"{entry['goal']:.4g}"
        yield described(entry, "[W] 4.1", "not more", "another elbow, a PID as good", goal)


def described(entry: dict[str, Any], source: str, tolerance: str, reason: str, published: str) -> Row:
    """A row of another benchmark in the form of this table."""
    kept = {"source": source, "quantity": entry["figure"], "published": published, "ours": entry["ours"],
            "unit": entry.get("unit", ""), "tolerance": tolerance, "reason": reason,
            "ok": bool(entry["ok"])}  # fmt: skip
    return {**kept, "why": entry["why"]} if "why" in entry else kept


def rows() -> Iterator[Row]:
    """All rows, system by system."""
    yield from tondu_rows()
    jax.clear_caches()
    yield from jet_pipe.rows()
    jax.clear_caches()
    yield from hysteresis_rows()
    jax.clear_caches()
    yield from closed_loop.rows()


if __name__ == "__main__":
    sys.exit(printed("published", __doc__, rows))
