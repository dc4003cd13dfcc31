"""The rows of the table: what is timed, against what, and the goal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import peers_c
import peers_casadi
import peers_cvodes
import peers_numbalsoda
import peers_ours
import peers_scipy
from peers_build import compiler
from peers_model import COMMAND, KNOTS, VALUES, deviation
from peers_settings import CORES, NO_COMPILER, Peers, best

COMPILE = {"run": 3.0, "jacobian": 5.0, "reverse": 8.0}
"""Goals for a cold compilation [s]."""
CVODES_RUNS = 256
"""The largest batch that CVODES is asked for: beyond, its states at all samples need gigabytes."""
DASK_RUNS = 131072
"""Runs of the sweep on dask: some seconds of one worker, against which the client's work is small."""
SAME = 1e-9
"""Relative; two programs that differ by less take the same steps."""

Row = dict[str, Any]
Times = dict[str, float]


def row(figure: str, goal: str, reached: float, ok: bool, why: str = "", **more: Any) -> Row:
    """A line of the table; `why` is kept where the goal is missed."""
    return {"figure": figure, "goal": goal, "ours": reached, "ok": ok, **more} | ({} if ok else {"why": why})


def skipped(figure: str, goal: str, reason: str) -> Row:
    """A line that nothing was measured for, which does not count."""
    return {"figure": figure, "goal": goal, "skipped": reason}


def beside(figure: str, goal: float, theirs: Times, ours: float, why: str, absent: str = "") -> Row:
    """The fastest of the peers over ours."""
    if not theirs:
        return skipped(figure, f"≥ {goal:g}", absent)
    name = min(theirs, key=lambda key: theirs[key])
    ratio = theirs[name] / ours
    return row(f"{figure} ({name})", f"≥ {goal:g}", ratio, ratio >= goal, why)


def single(peers: Peers) -> list[Row]:
    """One run, warm; each as it is called by whoever wants speed, ours also as it is called by most."""
    casadi: Times = {}
    if compiler() is not None:
        casadi["CasADi, fixed steps"] = best(peers_casadi.compiled("run", peers.casadi))
        casadi["CasADi, CVODES"] = best(lambda: peers_cvodes.position(peers.cvodes))
    lsoda = {"SciPy": best(lambda: peers_scipy.run(KNOTS, peers.lsoda))}
    if peers_numbalsoda.available():
        lsoda["numbalsoda"] = best(peers.numbalsoda[0])
    ours = best(peers_ours.compiled("run", peers.steps)[0])
    simulate = best(lambda: peers_ours.position(peers.model, COMMAND, peers.steps).block_until_ready())
    diffrax = {"diffrax": best(lambda: peers.diffrax(jnp.asarray(VALUES)).block_until_ready())}
    python = f"its compiled run takes {1e3 * ours:.2f} ms, the call {1e3 * (simulate - ours):.2f} ms more"
    alike = f"ours takes {1e3 * ours:.2f} ms"
    rows = [
        beside("one run: CasADi / jm.simulate", 1, casadi, simulate, python, NO_COMPILER),
        beside("one run: LSODA / jm.simulate", 1, lsoda, simulate, python),
        beside("one run: diffrax / jm.simulate", 1, diffrax, simulate, python),
        beside("one run, compiled: CasADi / ours", 1, casadi, ours, alike, NO_COMPILER),
    ]
    rows[0]["ms"] = {
        name: 1e3 * took
        for name, took in {
            "jm.simulate": simulate,
            "ours, compiled": ours,
            **casadi,
            **lsoda,
            **diffrax,
        }.items()
    }
    return rows


def batch(peers: Peers) -> list[Row]:
    """256 and 4096 runs, every peer on all cores."""
    rows = []
    for runs in (256, 4096):
        ours = best(peers_ours.batch(peers.model, runs, peers.steps))
        casadi: Times = {}
        if compiler() is not None:
            casadi["CasADi, fixed steps, threads"] = best(
                peers_casadi.batch(peers.casadi, runs, CORES), 0.0, 3
            )
            if runs <= CVODES_RUNS:
                cvodes = peers_cvodes.batch(peers.cvodes, runs, CORES)
                casadi["CasADi, CVODES, threads"] = best(cvodes, 0.0, 2)
        scipy = peers_scipy.batch(peers.pool, CORES, runs, peers.lsoda)
        lsoda = {"SciPy, processes": best(scipy, 0.0, 2 if runs <= CVODES_RUNS else 1)}
        if peers_numbalsoda.available():
            lsoda["numbalsoda, threads"] = best(peers.numbalsoda[1](runs), 0.0, 3)
        called = f"{lsoda['SciPy, processes'] / ours:.0f} against SciPy, which calls the model through Python"
        each = f"jm.sweep takes {1e6 * ours / runs:.1f} us a run"
        found = [
            beside(f"{runs} runs: CasADi / jm.sweep", 3, casadi, ours, each, NO_COMPILER),
            beside(f"{runs} runs: LSODA / jm.sweep", 20, lsoda, ours, called),
        ]
        found[0]["us a run"] = {
            name: 1e6 * took / runs for name, took in {"jm.sweep": ours, **casadi, **lsoda}.items()
        }
        rows += found
    return rows


def c(peers: Peers) -> list[Row]:
    """The same steps in C."""
    runs, figure = 4096, "4096 runs, same steps: jm.sweep / C"
    if compiler() is None:
        return [skipped(figure, "≤ 2", NO_COMPILER)]
    lib, substeps = peers_c.library(), next(n for name, n in peers_ours.TRIED if name == "heun" and n > 1)
    theirs = peers_c.batch(lib, runs, substeps)
    ours = peers_ours.batch(peers.model, runs, ("heun", substeps))
    apart = deviation(theirs()[0], ours())
    assert apart < SAME, f"not the same steps: {apart}"
    limit, mine = best(theirs, 1.0), best(ours, 1.0)
    # What a call takes however many runs it has, and what a further run takes: from twice as many.
    further = best(peers_ours.batch(peers.model, 2 * runs, ("heun", substeps)), 1.0) - mine
    call = mine - further
    one = f"a further run takes {1e6 * further / runs:.1f} us"
    why = f"{1e3 * call:.0f} ms of the call do not depend on the runs; {one}"
    each = {"jm.sweep": 1e6 * mine / runs, "C": 1e6 * limit / runs}
    return [row(figure, "≤ 2", mine / limit, mine <= 2 * limit, why, **{"us a run": each})]


def slopes(peers: Peers) -> list[Row]:
    """Jacobian and gradient, relative to a run and to CasADi's."""
    took = {name: best(peers_ours.compiled(name, peers.steps)[0]) for name in COMPILE}
    jacobians: Times = {}
    gradients: Times = {}
    if compiler() is not None:
        calls = {name: peers_casadi.compiled(name, peers.casadi) for name in ("jacobian", "gradient")}
        agree(peers, calls)
        jacobians["CasADi, fixed steps"] = best(calls["jacobian"])
        jacobians["CasADi, CVODES"] = best(peers_cvodes.jacobian(peers.cvodes), 0.0, 2)
        gradients["CasADi, fixed steps"] = best(calls["gradient"])
    jacobian, reverse = took["jacobian"] / took["run"], took["reverse"] / took["run"]
    each = f"a run takes {1e3 * took['run']:.2f} ms"
    sparse = "its sensitivities multiply the sparse derivatives of each stage (peers_casadi.py)"
    stored = "it goes back over stored states, in straight C"
    rows = [
        row("Jacobian, 12 parameters: runs", "≤ 5", jacobian, jacobian <= 5, each),
        beside("Jacobian: CasADi / ours", 3, jacobians, took["jacobian"], sparse, NO_COMPILER),
        row("gradient, 100 parameters: runs", "≤ 5", reverse, reverse <= 5, each),
        beside("gradient: CasADi / ours", 1, gradients, took["reverse"], stored, NO_COMPILER),
    ]
    rows[1]["ms"] = {name: 1e3 * value for name, value in {"ours": took["jacobian"], **jacobians}.items()}
    rows[3]["ms"] = {name: 1e3 * value for name, value in {"ours": took["reverse"], **gradients}.items()}
    return rows


def agree(peers: Peers, calls: dict[str, Callable[[], np.ndarray]]) -> None:
    """CasADi's derivatives are ours, in the steps that it takes."""
    slopes = np.asarray(peers_ours.compiled("jacobian", peers.casadi)[0]()).T
    slopes = slopes * VALUES[list(peers_ours.FREE), None]
    gradient = np.asarray(peers_ours.compiled("reverse", peers.casadi)[0]())
    for name, ours in (("jacobian", slopes), ("gradient", gradient)):
        apart = np.abs(calls[name]().reshape(ours.shape) - ours).max() / np.abs(ours).max()
        assert apart < SAME, f"{name} of CasADi and ours are {apart:.1e} apart"


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
    (few, dear), (many, cheap) = ((e["points"], e["us_a_point"]) for e in found[3:5])
    call = (dear - cheap) * few * many / (many - few)
    why = f"{1e-3 * call:.0f} ms of a call do not depend on its points (from {few:.0f} and {many:.0f})"
    return [row("cost a point, 4096 to 100,000: largest / smallest", "falls, then flat", flat, ok, why,
                grown_MiB=grown, points=found)]  # fmt: skip


def dask(peers: Peers) -> list[Row]:
    """Two workers over one."""
    took = peers_ours.shared_out(peers.steps, DASK_RUNS)
    ratio = took[1] / took[2]
    why = f"client and scheduler share the {CORES} cores with the workers"
    return [row("two dask workers over one", "≥ 1.7", ratio, ratio >= 1.7, why, runs=DASK_RUNS)]


SECTIONS = {
    "single": single, "batch": batch, "c": c, "slopes": slopes, "compile": compile, "points": points,
    "dask": dask,
}  # fmt: skip
