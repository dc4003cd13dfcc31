"""Can the intervals of a fit be believed, do bad starts arrive, and how fast beside scipy.optimize?

Recordings come from the one-page oracles of the tests (plain NumPy, no code shared with the model): a muscle
pulled by a test machine, with thread friction, and a muscle that lifts a mass.

    python benchmarks/fitting.py [--repeats 6] [--starts 8] [--json]
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from estimation.made import (  # pyright: ignore[reportMissingImports]
    LIFT_TRUE,
    TRUE,
    lifted,
    pulled,
)
from oracles import bench  # pyright: ignore[reportMissingImports]

import jaxmuscle as jm
from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import Limits
from jaxmuscle.estimation.layout import Asked, layout
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.slopes import residual_vector
from jaxmuscle.estimation.spread import weighted
from jaxmuscle.estimation.stations import station
from jaxmuscle.recordings import Recording

THREADS = {f"effects.thread_friction.{name}": value for name, value in bench.THREADS.items()}
CASES: dict[str, tuple[Callable[[int], Recording], dict[str, float]]] = {
    "driven": (lambda seed: pulled(seed, threads=True), {**TRUE, **THREADS}),
    "lift": (lambda seed: lifted(10.0, seed=seed), LIFT_TRUE),
}
LEVEL = 0.95
SURE = 0.99
"""Coverage is called wrong when it would come out like that in fewer of 100 such benchmarks."""
OFF = 0.5
SAME = 1e-3
"""Relative difference of two costs up to which they are the same."""


def coverage(name: str, repeats: int) -> dict[str, Any]:
    """Part of the 95 % intervals that hold the truth."""
    make, true = CASES[name]
    hits = []
    for seed in range(repeats):
        recording = make(seed)
        priors = dict.fromkeys(true)
        result = jm.fit(jm.actuator(recording.card), recording, list(true), priors=priors)
        for parameter, value in true.items():
            low, high = result.parameters[parameter].interval()
            hits.append(low <= value <= high)
    count, total = int(sum(hits)), len(hits)
    least = int(binom.ppf(1 - SURE, total, LEVEL))
    row = {
        "figure": f"{name}: 95 % intervals that hold the truth",
        "goal": f"at least {least} of {total}",
        "ours": count / total,
        "count": count,
        "of": total,
        "ok": count >= least,
    }
    return row if row["ok"] else {**row, "why": "the standard deviations are too small"}


def arriving(name: str, starts: int) -> dict[str, Any]:
    """Part of the starts, every parameter 50 % too small or too large, that reach the best minimum."""
    make, true = CASES[name]
    recording, rng = make(0), np.random.default_rng(1)
    given = [{p: float(v * (1 + OFF * rng.choice([-1, 1]))) for p, v in true.items()} for _ in range(starts)]
    result = jm.fit(
        jm.actuator(recording.card), recording, list(true), priors=dict.fromkeys(true), starts=given
    )
    reached = sum(start.reached for start in result.starts)
    codes = [start.code for start in result.starts]
    row = {
        "figure": f"{name}: starts 50 % off that reach the best minimum",
        "goal": "at least 0.9",
        "ours": reached / starts,
        "of": starts,
        "ends": {code: codes.count(code) for code in dict.fromkeys(codes)},
        "ok": reached / starts >= 0.9,
    }
    return row if row["ok"] else {**row, "why": "other minima, or places where no step lowers the cost"}


def racing(name: str) -> list[dict[str, Any]]:
    """Seconds to the same cost from the same start, on the same simulator, weights and priors.

    Everything that the card calls uncertain is fitted; the lift is the sample that comes with the package.
    """
    recording = jm.read(jm.sample("lift")) if name == "lift" else CASES[name][0](0)
    actuator = jm.actuator(recording.card)
    unknowns = layout(actuator, [recording], [name], Asked())
    objective = Objective([station(actuator, recording, name, None, {})], unknowns, Squares())
    objective = weighted(objective, unknowns.coordinates(unknowns.start))
    start = unknowns.coordinates(1.15 * unknowns.start)
    rows = []
    for state in ("cold", "warm"):
        ours = _ours(objective, start)
        theirs = _scipys(objective, start)
        target = max(ours[-1][1], theirs[-1][1]) * (1 + SAME)
        seconds = [next(t for t, cost in trace if cost <= target) for trace in (ours, theirs)]
        row = {
            "figure": f"{name}: seconds to the same cost, {state}",
            "goal": "less than scipy.optimize.least_squares with finite differences",
            "ours": seconds[0],
            "scipy": seconds[1],
            "final_costs": [ours[-1][1], theirs[-1][1]],
            "ok": seconds[0] < seconds[1],
        }
        why = "compiling the derivatives takes longer than they save" if state == "cold" else "small problem"
        rows.append(row if row["ok"] else {**row, "why": why})
    return rows


Trace = list[tuple[float, float]]


def _ours(objective: Objective, start: NDArray[np.float64]) -> Trace:
    begin, trace = time.perf_counter(), []
    unknowns = objective.unknowns
    limits = Limits(unknowns.lower, unknowns.upper, 60, 1, samples=objective.samples)
    descend(
        objective.at,
        start[None],
        limits,
        tell=lambda course: trace.append((time.perf_counter() - begin, course.cost)),
    )
    return trace


@eqx.filter_jit
def _values(theta, actuator, problem, paths):
    return residual_vector(theta, actuator, problem, paths)


def _scipys(objective: Objective, start: NDArray[np.float64]) -> Trace:
    begin, trace = time.perf_counter(), []
    unknowns, place = objective.unknowns, objective.stations[0]
    paths = tuple(entry.place.path for entry in unknowns.entries)

    def residuals(u: NDArray[np.float64]) -> NDArray[np.float64]:
        r = np.asarray(_values(jnp.asarray(unknowns.values(u)), place.actuator, place.problem, paths))
        whole = np.concatenate([r, unknowns.prior_residuals(u)])
        cost = 0.5 * float(whole @ whole)
        trace.append((time.perf_counter() - begin, min(cost, trace[-1][1] if trace else np.inf)))
        return whole

    least_squares(residuals, start, jac="2-point", x_scale="jac", method="trf")
    return trace


def main() -> None:
    """Run everything and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=6, help="recordings for the coverage of each case")
    parser.add_argument("--starts", type=int, default=8, help="starts that are 50 %% off")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows = time.perf_counter(), []
    for name in CASES:
        # The race first, so that nothing is compiled before it.
        rows += racing(name)
        rows += [coverage(name, arguments.repeats), arriving(name, arguments.starts)]
    for row in rows:
        scipy = f"   scipy {row['scipy']:.3g} s" if "scipy" in row else ""
        print(
            f"{'ok  ' if row['ok'] else 'MISS'} {row['figure']:<58} {row['ours']:.3g}{scipy}"
            f"   goal: {row['goal']}"
        )
    if arguments.json:
        summary = {
            "benchmark": "fitting",
            "rows": rows,
            "reached": sum(row["ok"] for row in rows),
            "of": len(rows),
            "machine": platform.processor() or platform.machine(),
            "seconds": time.perf_counter() - begin,
        }
        print(json.dumps(summary))


if __name__ == "__main__":
    main()
