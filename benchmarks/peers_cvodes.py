"""CasADi with CVODES: one run, a batch over all cores, forward sensitivities."""

from __future__ import annotations

from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np
from peers_build import OPS, PLAIN, compiler
from peers_model import CLOCK, COMMAND, FREE, MASS, NAMES, START, START_SLOPES, STEP, VALUES, masses, rates

TRIED = (
    (1e-4, "adams"), (1e-4, "bdf"), (3e-5, "bdf"), (1e-5, "adams"), (1e-5, "bdf"), (3e-6, "adams"),
    (3e-6, "bdf"), (1e-6, "adams"), (1e-6, "bdf"),
)  # fmt: skip
"""Tolerances and families of methods."""
SCALES = np.array([1.0, 1e5, 0.1, 0.1, *[0.1] * 8])


def integrator(tolerance: float, method: str = "bdf", compiled: bool = False) -> Any:
    """Scaled states at the samples from (start, parameters, command at each sample)."""
    z, q, u = ca.SX.sym("z", 12), ca.SX.sym("q", len(NAMES)), ca.SX.sym("u")
    state = [z[i] * SCALES[i] for i in range(12)]
    own, plays = rates(state, u, ca.vertsplit(q), OPS)
    dae = {"x": z, "p": q, "u": u, "ode": ca.vertcat(*own, *plays) / SCALES}
    options = {
        "reltol": tolerance, "abstol": tolerance, "linear_multistep_method": method, "max_num_steps": 100000,
        "fsens_err_con": False,
    }  # fmt: skip
    if compiled:
        flags = {"flags": ["-O3", *PLAIN[:-2]], "compiler": compiler()}
        options |= {"jit": True, "compiler": "shell", "jit_options": flags}
    return ca.integrator("run", "cvodes", dae, 0.0, [*(CLOCK[1:]), CLOCK[-1] + STEP], options)


def command() -> np.ndarray:
    """The command of each interval, one row."""
    return COMMAND[None, :]


def position(solver: Any, q: np.ndarray = VALUES) -> np.ndarray:
    """Position at the samples."""
    found = solver(x0=START / SCALES, p=q, u=command())["xf"]
    return np.concatenate([[START[2]], np.asarray(found)[2, :-1] * SCALES[2]])


def batch(solver: Any, runs: int, cores: int) -> Any:
    """A function without arguments that makes `runs` runs of different masses on all cores."""
    mapped = solver.map(runs, "thread", cores)
    q = np.repeat(VALUES[:, None], runs, axis=1)
    q[MASS] = masses(runs)
    start = np.repeat((START / SCALES)[:, None], runs, axis=1)
    held = np.tile(command(), (1, runs))
    return lambda: mapped(x0=start, p=q, u=held)["xf"]


def jacobian(solver: Any) -> Any:
    """A function that gives the slopes of the position in the twelve parameters, relative to their values."""
    count = len(FREE)
    forward = solver.forward(count)
    seeds = np.zeros((len(NAMES), count))
    seeds[list(FREE), range(count)] = VALUES[list(FREE)]
    start = START / SCALES
    found = solver(x0=start, p=VALUES, u=command())
    given = {name: found[name] for name in found}
    given |= {f"out_{name}": found[name] for name in found} | {"x0": start, "p": VALUES, "u": command()}
    names = forward.name_in()
    call = {name: given[name] for name in names if name in given}
    call |= {"fwd_p": seeds, "fwd_x0": START_SLOPES * VALUES[list(FREE)] / SCALES[:, None]}
    return lambda: np.asarray(forward(**call)["fwd_xf"]).reshape(12, count, len(COMMAND))[2] * SCALES[2]
