"""How accurate is a simulation for the time that it takes? Methods, substeps and tolerances side by side.

The isotonic machine with friction and hysteresis lifts a mass, lets it fall and catches it (2 s at 500 Hz);
errors are of the position, relative to its range, against controlled steps with a tolerance of 1e-11.

    python benchmarks/accuracy.py [--picture accuracy.png] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxmuscle as jm
from jaxmuscle.simulation.solvers import CONTROLLED, METHODS

CLOCK = 0.002 * np.arange(1000)
COMMAND = np.select([CLOCK % 1 < 0.2, CLOCK % 1 < 0.7], [3.0, -2.0], 1.0)
SUBSTEPS = (1, 2, 4, 8, 16, 32)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
Row = dict[str, Any]


def machine() -> Any:
    """The sample's muscle with dry friction of the guide and hysteresis besides."""
    return jm.actuator(jm.read(jm.sample("lift")).card).with_effects(
        load_friction=jm.effects.LoadFriction(force=jnp.asarray(16.0)),
        length_hysteresis=jm.effects.LengthHysteresis(weight=jnp.asarray(0.05)),
    )


def best(function: Callable[[], Any]) -> float:
    """Shortest of several times [s] after the first."""
    function()
    times = []
    while len(times) < 5 or sum(times) < 0.1:
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return min(times)


def curves() -> list[Row]:
    """Error, its estimate and time of every setting."""
    model = machine()

    def position(**asked: Any) -> Any:
        return jm.simulate(model, COMMAND, CLOCK, **asked)

    exact = np.asarray(position(method="dormand-prince", tolerance=1e-11, substeps=16).readings["position"])
    span, rows = np.ptp(exact), []
    settings = [(name, {"method": name, "substeps": n}) for name in METHODS for n in SUBSTEPS]
    for name in CONTROLLED:
        settings += [(f"{name}, controlled", {"method": name, "tolerance": t}) for t in TOLERANCES]
    for curve, asked in settings:
        found = position(**asked, error=True)
        assert found.error is not None
        error = np.abs(np.asarray(found.readings["position"]) - exact).max() / span
        took = best(lambda asked=asked: position(**asked).readings["position"].block_until_ready())
        estimate = float(found.error["position"][-1]) / span
        figures = {"error": float(error), "estimate": float(estimate), "ms": 1e3 * took}
        rows.append({"curve": curve, **asked, **figures})
    return rows


def draw(rows: list[Row], target: Path) -> None:
    """Error over time, one curve a method."""
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    axes = figure.add_subplot()
    for i, name in enumerate(dict.fromkeys(row["curve"] for row in rows)):
        own = [row for row in rows if row["curve"] == name]
        style = "--s" if "controlled" in name else "-o"
        color = f"C{i if 'controlled' not in name else list(METHODS).index(name.split(',')[0])}"
        axes.loglog([r["ms"] for r in own], [r["error"] for r in own], style, color=color, ms=4, label=name)
    axes.set_xticks([2, 5, 10, 20, 50], labels=["2", "5", "10", "20", "50"])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("time of a run of 2 s at 500 Hz [ms]")
    axes.set_ylabel("largest error of the position / its range")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(target, dpi=150)


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--picture", type=Path, help="where to draw the curves")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows = time.perf_counter(), curves()
    for row in rows:
        setting = row.get("substeps") or row.get("tolerance")
        figures = f"error {row['error']:.1e}  estimate {row['estimate']:.1e}  {row['ms']:7.2f} ms"
        print(f"{row['curve']:<30} {setting:<8g} {figures}")
    bounded = sum(row["error"] <= row["estimate"] for row in rows)
    print(f"the estimate bounds the error in {bounded} of {len(rows)} settings")
    if arguments.picture:
        draw(rows, arguments.picture)
    if arguments.json:
        summary = {
            "benchmark": "accuracy", "rows": rows, "reached": bounded, "of": len(rows),
            "load": os.getloadavg(), "machine": platform.processor() or platform.machine(),
            "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        print(json.dumps(summary))


if __name__ == "__main__":
    main()
