"""Do the hysteresis models of [W] and [H] do what their papers say, and what of it was to be had?

Loops: what the best fits of the classical and of the modified model leave, in the measure of [W] (22.67 % and
4.65 % there, on measured loops). Minor loops of relays: [H] found Frame's rule no better than the mid-line.
Compensation of an elbow made of relays: PID alone, with the classical and with the modified model inside.

The measured loops are not printed, so every row is a check of our own on other loops: none is counted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

import hysteresis_compensation as compensation
import hysteresis_loops as loops
import hysteresis_minor as minor
import jax
from published_rows import OWN, Row, aside, at_most, printed, row

from jaxmuscle.hysteresis.prandtl_ishlinskii import PUBLISHED_ERRORS

from oracles.relays import MATERIALS  # pyright: ignore[reportMissingImports]  # isort: skip

SEVERAL = 3.0
"""How many times smaller than the mid-line's the error of play operators should be on minor loops."""
BETTER = PUBLISHED_ERRORS["modified"] / PUBLISHED_ERRORS["classical"]
"""Largest error of the modified over that of the classical model on the loops of [W]: 0.205."""


def loop_rows() -> Iterator[Row]:
    print(f"{'largest error relative to the range':36s} {'classical':>10s} {'free':>8s} {'modified':>9s}")
    for loop in loops.loops():
        found = {name: loops.error(model, loop) for name, model in loops.fits(loop).items()}
        print(f"{loop.name:36s} " + " ".join(f"{100 * e:8.2f}%" for e in found.values()))
        best = min(found["classical, exponential"], found["classical, free weights"])
        kind = "refit to a loop of its own" if loop.maker is not None else "fit to relays"
        goals = {"modified": PUBLISHED_ERRORS["modified"], "modified over classical": BETTER}
        ours = {"modified": found["modified"], "modified over classical": found["modified"] / best}
        for name, goal in goals.items():
            entry = at_most("[W] section 2", f"{loop.name}: {name}, {kind}", f"{goal:.4g}", ours[name], "",
                            "measured loops there", "another loop than those of [W]")  # fmt: skip
            yield {**aside(entry, OWN), "all": found}


def minor_rows() -> Iterator[Row]:
    for name, make in MATERIALS.items():
        found = minor.errors(make())
        print(f"\nminor loops, {name}: rms error relative to the range")
        print(f"{'':14s} " + " ".join(f"{loop:>12s}" for loop in found["Frame"]))
        for way, errors in found.items():
            print(f"{way:14s} " + " ".join(f"{100 * e:11.2f}%" for e in errors.values()))
        ours = max(found["modified [W]"]["all"], found["generalized"]["all"])
        for rival in ("mid-line", "Frame"):
            factor = found[rival]["all"] / ours
            figure = f"minor loops, {name}: {rival} over play operators"
            entry = row("[H] 3.2.2", figure, f"{SEVERAL:g}", factor, factor >= SEVERAL, "", "at least",
                        "[H] predicted no minor loop")  # fmt: skip
            yield {**aside(entry, OWN), "all": found}


PARTS: tuple[Callable[[], Iterator[Row]], ...] = (loop_rows, minor_rows, compensation.rows)


def rows() -> Iterator[Row]:
    """All rows."""
    for part in PARTS:
        yield from part()
        jax.clear_caches()


if __name__ == "__main__":
    sys.exit(printed("hysteresis", __doc__, rows))
