"""The rows of the table: what is timed, against what, and the goal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import peers_c
import peers_casadi
import peers_ours
import peers_scipy
from peers_model import COMMAND, KNOTS, VALUES, deviation
from peers_settings import Peers, best

from jaxmuscle.cores import cores

CORES = cores()
COMPILE = {"run": 3.0, "jacobian": 5.0, "reverse": 8.0}
"""Goals for a cold compilation [s]."""
CVODES_RUNS = 64
"""Runs of CVODES that are timed: each costs the same, however many there are."""
DASK_RUNS = 131072
"""Runs of the sweep on dask: some seconds of one worker, against which the client's work is small."""

Row = dict[str, Any]


def row(figure: str, goal: str, reached: float, ok: bool, why: str = "", **more: Any) -> Row:
    """A line of the table; `why` is kept where the goal is missed."""
    return {"figure": figure, "goal": goal, "ours": reached, "ok": ok, **more} | ({} if ok else {"why": why})


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
    why = "of 0.7 ms of a call 0.4 ms are Python: equinox and eight small operations (cProfile)"
    return [row("one run, warm: CVODES / ours (jm.simulate)", "≥ 1", ratio, ratio >= 1, why, **found)]


def batch(peers: Peers) -> list[Row]:
    """256 and 4096 runs."""
    scipy, rows = best(lambda: peers_scipy.run(KNOTS, peers.lsoda)), []
    for runs in (256, 4096):
        ours = best(peers_ours.batch(peers.model, runs, peers.steps)) / runs
        cvodes = best(peers_casadi.batch(peers.cvodes, CVODES_RUNS, CORES), 0.0, 2) / CVODES_RUNS
        many = {"ours_us": 1e6 * ours, "cvodes_us": 1e6 * cvodes, "scipy_us": 1e6 * scipy}
        why = "see the row of the C: the same batches"
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
    why = "measured apart, a core takes 35 us a run where C takes 19; the rest is the call itself"
    return [row(f"{runs} runs, same steps: ours / C", "≤ 2", mine / limit, mine <= 2 * limit, why,
                ours_us=1e6 * mine / runs, c_us=1e6 * limit / runs)]  # fmt: skip


def slopes(peers: Peers) -> list[Row]:
    """Jacobian and gradient, relative to a run and to CVODES."""
    took = {name: best(peers_ours.compiled(name, peers.steps)[0]) for name in COMPILE}
    theirs = best(peers_casadi.jacobian(peers.cvodes), 0.0, 2)
    jacobian, reverse = took["jacobian"] / took["run"], took["reverse"] / took["run"]
    beside = theirs / took["jacobian"]
    why = (
        "LLVM may not assume that XLA's buffers are disjoint, and leaves loops over twelve tangents scalar; "
        "if it may, 1.25 ms, but derivatives of another rig come out wrong (settings.py)"
    )
    short = "each step is computed forward once more, then backward in scalars"
    return [
        row("Jacobian, 12 parameters: runs", "≤ 5", jacobian, jacobian <= 5, why, ms=1e3 * took["jacobian"]),
        row("Jacobian: CVODES forward / ours", "≥ 3", beside, beside >= 3, why, cvodes_ms=1e3 * theirs),
        row("gradient, 100 parameters: runs", "≤ 5", reverse, reverse <= 5, short,
            ms=1e3 * took["reverse"]),
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
        rows.append(
            row(
                f"cold compile, {name} [s]",
                f"≤ {goal:g}",
                took,
                took <= goal,
                "compile_times.py parts it into tracing and compiling",
            )
        )
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
    why = "at 4096 points what a call takes beside its runs, some 20 ms by difference, still shows"
    return [row("cost a point, 4096 to 100,000: largest / smallest", "falls, then flat", flat, ok, why,
                grown_MiB=grown, points=found)]  # fmt: skip


def dask(peers: Peers) -> list[Row]:
    """Two workers over one."""
    took = peers_ours.shared_out(peers.steps, DASK_RUNS)
    ratio = took[1] / took[2]
    why = "client and scheduler share the two cores with the workers"
    return [row("two dask workers over one", "≥ 1.7", ratio, ratio >= 1.7, why, runs=DASK_RUNS)]


SECTIONS = {
    "single": single, "batch": batch, "c": c, "slopes": slopes, "compile": compile, "points": points,
    "dask": dask,
}  # fmt: skip
