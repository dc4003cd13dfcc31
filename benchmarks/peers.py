"""How fast beside SciPy, CasADi with CVODES, plain diffrax and hand-written C, at equal accuracy?

All integrate the one-muscle model of `peers_model.py` over 2 s at 500 Hz, each with the loosest setting that
keeps the position within 1e-4 of a reference that is exact to 1e-10. Needs casadi and numba, and for the
limit a C compiler.

    python benchmarks/peers.py [--only single batch c slopes compile points dask] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import peers_c
import peers_casadi
import peers_diffrax
import peers_ours
import peers_scipy
from peers_model import ACCURACY, COMMAND, KNOTS, VALUES, deviation

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
SECTIONS = ("single", "batch", "c", "slopes", "compile", "points", "dask")
COMPILE = {"run": 3.0, "jacobian": 5.0, "reverse": 8.0}
"""Goals for a cold compilation [s]."""
CVODES_RUNS = 64
"""Runs of CVODES that are timed: each costs the same, however many there are."""
DASK_RUNS = 16384

Row = dict[str, Any]


def best(function: Callable[[], Any], least: float = 0.5, repeats: int = 5) -> float:
    """Shortest of several times [s], after a first call that does not count."""
    function()
    times, begin = [], time.perf_counter()
    while len(times) < repeats or time.perf_counter() - begin < least:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def row(figure: str, goal: str, reached: float, ok: bool, why: str = "", **more: Any) -> Row:
    """A line of the table; `why` is kept where the goal is missed."""
    return {"figure": figure, "goal": goal, "ours": reached, "ok": ok, **more} | ({} if ok else {"why": why})


class Peers:
    """Every peer at the loosest setting that is accurate enough, found when it is first asked for."""

    def __init__(self) -> None:
        """Compute the reference."""
        self.exact = peers_scipy.reference(COMMAND, VALUES, 4000)
        self.model = peers_ours.machine()
        self.accuracy = {"reference": deviation(peers_scipy.reference(COMMAND, VALUES, 2000), self.exact)}

    def choose(self, name: str, tried: Iterable[Any], run: Callable[[Any], Any], most: int = 1) -> Any:
        """The fastest of the first `most` settings that are accurate enough."""
        found = []
        for setting in tried:
            try:
                error = deviation(run(setting), self.exact)
            except RuntimeError as failed:
                print(f"{name:<10} {setting!s:<28} fails: {str(failed).splitlines()[-1]}", flush=True)
                continue
            if error <= ACCURACY:
                took = best(lambda s=setting: jax.block_until_ready(run(s)), 0.1, 3)
                found.append((took, error, setting))
            if len(found) == most:
                break
        took, error, setting = min(found)
        self.accuracy[name] = error
        print(f"{name:<10} {setting!s:<28} error {error:.1e}  {1e3 * took:.2f} ms", flush=True)
        return setting

    @cached_property
    def steps(self) -> peers_ours.Steps:
        """Our method and substeps."""
        return self.choose("ours", peers_ours.TRIED, lambda s: peers_ours.position(self.model, COMMAND, s), 2)

    @cached_property
    def lsoda(self) -> float:
        """SciPy's tolerance."""
        return self.choose("scipy", peers_scipy.TOLERANCES, lambda tol: peers_scipy.run(KNOTS, tol))

    @cached_property
    def cvodes(self) -> Any:
        """CasADi's integrator, its right-hand side compiled if there is a compiler."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[float, str]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_casadi.integrator(*setting, compiled=peers_c.compiler() is not None)
            return peers_casadi.position(solvers[setting])

        tried = [(tol, method) for tol in peers_casadi.TOLERANCES for method in ("bdf", "adams")]
        return solvers[self.choose("cvodes", tried, run, 3)]

    @cached_property
    def diffrax(self) -> Any:
        """The compiled solve of plain diffrax."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[str, float]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_diffrax.solver(*setting)
            return solvers[setting](jnp.asarray(VALUES))

        return solvers[self.choose("diffrax", peers_diffrax.TRIED, run)]


def single(peers: Peers) -> list[Row]:
    """One run, warm."""
    ready, _ = peers_ours.compiled("run", peers.steps)
    times = {
        "ours": best(ready),
        "simulate": best(lambda: peers_ours.position(peers.model, COMMAND, peers.steps).block_until_ready()),
        "cvodes": best(lambda: peers_casadi.position(peers.cvodes)),
        "scipy": best(lambda: peers_scipy.run(KNOTS, peers.lsoda)),
        "diffrax": best(lambda: peers.diffrax(jnp.asarray(VALUES)).block_until_ready()),
    }
    found = {f"{name}_ms": 1e3 * took for name, took in times.items()}
    ratio = times["cvodes"] / times["simulate"]
    why = "the loop over samples costs about 1 us each, whatever is in it"
    return [row("one run, warm: CVODES / ours (jm.simulate)", "≥ 1", ratio, ratio >= 1, why, **found)]


def batch(peers: Peers) -> list[Row]:
    """256 and 4096 runs."""
    scipy, rows = best(lambda: peers_scipy.run(KNOTS, peers.lsoda)), []
    for runs in (256, 4096):
        ours = best(peers_ours.batch(peers.model, runs, peers.steps)) / runs
        cvodes = best(peers_casadi.batch(peers.cvodes, CVODES_RUNS, CORES), 0.0, 2) / CVODES_RUNS
        many = {"ours_us": 1e6 * ours, "cvodes_us": 1e6 * cvodes, "scipy_us": 1e6 * scipy}
        why = "the fixed costs of a sweep weigh on few runs"
        rows.append(
            row(
                f"{runs} runs: CVODES on all cores / ours",
                "≥ 3",
                cvodes / ours,
                cvodes >= 3 * ours,
                why,
                **many,
            )
        )
        rows.append(row(f"{runs} runs: SciPy / ours", "≥ 20", scipy / ours, scipy >= 20 * ours, why))
    return rows


def c(peers: Peers) -> list[Row]:
    """The same steps in C."""
    if peers_c.compiler() is None:
        return [row("same steps as the C: ours / C", "≤ 2", float("nan"), True, skipped="no C compiler")]
    lib, substeps = peers_c.library(), next(n for name, n in peers_ours.TRIED if name == "heun" and n > 1)
    runs = 4096
    theirs = peers_c.batch(lib, runs, substeps)
    ours = peers_ours.batch(peers.model, runs, ("heun", substeps))
    apart = deviation(theirs()[0], ours()) if runs > 1 else 0.0
    assert apart < 1e-9, f"not the same steps: {apart}"
    limit, mine = best(theirs, 1.0), best(ours, 1.0)
    why = "XLA makes a kernel of each stage's signals; C keeps a block of runs in registers and cache"
    return [row(f"{runs} runs, same steps: ours / C", "≤ 2", mine / limit, mine <= 2 * limit, why,
                ours_us=1e6 * mine / runs, c_us=1e6 * limit / runs)]  # fmt: skip


def slopes(peers: Peers) -> list[Row]:
    """Jacobian and gradient, relative to a run and to CVODES."""
    took = {name: best(peers_ours.compiled(name, peers.steps)[0]) for name in COMPILE}
    theirs = best(peers_casadi.jacobian(peers.cvodes), 0.0, 2)
    jacobian, reverse = took["jacobian"] / took["run"], took["reverse"] / took["run"]
    beside = theirs / took["jacobian"]
    why = "a run keeps to one kernel a stage, its slopes take thirty to a hundred short ones, each 70 ns"
    return [
        row("Jacobian, 12 parameters: runs", "≤ 5", jacobian, jacobian <= 5, why, ms=1e3 * took["jacobian"]),
        row("Jacobian: CVODES forward / ours", "≥ 3", beside, beside >= 3, why, cvodes_ms=1e3 * theirs),
        row("gradient, 100 parameters: runs", "≤ 5", reverse, reverse <= 5, why, ms=1e3 * took["reverse"]),
    ]  # fmt: skip


def fresh(*arguments: str) -> Any:
    """What `peers_ours.py` prints in a process of its own, without the compile cache."""
    environment = {**os.environ, "JAX_ENABLE_COMPILATION_CACHE": "false"}
    command = [sys.executable, str(Path(__file__).with_name("peers_ours.py")), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def compile(peers: Peers) -> list[Row]:
    """Cold compilations in fresh processes."""
    rows = []
    for name, goal in COMPILE.items():
        took = min(fresh(name, peers.steps[0], str(peers.steps[1])) for _ in range(2))
        why = "the time is that of LLVM for the stages, which are written out for the speed of a run"
        rows.append(row(f"cold compile, {name} [s]", f"≤ {goal:g}", took, took <= goal, why))
    return rows


def points(peers: Peers) -> list[Row]:
    """Cost a point from 1 to 100,000."""
    found = fresh("points", peers.steps[0], str(peers.steps[1]))
    for entry in found:
        print(
            "  {points:>7.0f} points {us_a_point:10.1f} us a point, peak {peak_MiB:.0f} MiB".format(**entry)
        )
    cost, grown = [e["us_a_point"] for e in found], found[-1]["peak_MiB"] - found[0]["peak_MiB"]
    flat = max(cost[3:]) / min(cost[3:])
    ok = cost[0] > cost[1] > cost[2] > 0.9 * cost[3] and flat < 1.3 and grown < 1024
    why = "from 4096 points on the cost is not within 30 %"
    return [row("cost a point, 4096 to 100,000: largest / smallest", "falls, then flat", flat, ok, why,
                grown_MiB=grown, points=found)]  # fmt: skip


def dask(peers: Peers) -> list[Row]:
    """Two workers over one."""
    took = peers_ours.shared_out(peers.steps, DASK_RUNS)
    ratio = took[1] / took[2]
    why = "scheduler, client and workers share the cores"
    return [row("two dask workers over one", "≥ 1.7", ratio, ratio >= 1.7, why, runs=DASK_RUNS)]


def main() -> None:
    """Run the sections and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=SECTIONS, help="sections to run")
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows, peers = time.perf_counter(), [], Peers()
    for name in arguments.only:
        for line in globals()[name](peers):
            rows.append(line)
            told = f"   why: {line['why']}" if "why" in line else ""
            figures = f"{line['figure']:<52} {line['ours']:.3g}   goal: {line['goal']}"
            print(f"{'ok  ' if line['ok'] else 'MISS'} {figures}{told}", flush=True)
    if arguments.json:
        summary = {
            "benchmark": "peers", "rows": rows, "reached": sum(line["ok"] for line in rows), "of": len(rows),
            "accuracy": peers.accuracy, "cores": CORES, "machine": platform.processor() or platform.machine(),
            "load": os.getloadavg(), "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        print(json.dumps(summary))


if __name__ == "__main__":
    # Workers of a cluster begin by importing this file.
    main()
