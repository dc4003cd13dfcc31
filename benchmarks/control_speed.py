"""Cost and gradient of a thousand closed loops beside CasADi and do-mpc, in one run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np
from control_casadi import Numbers, all_costs, sample
from control_race import SIZES, TIMES, problem
from do_mpc.model import Model  # pyright: ignore[reportMissingImports]
from do_mpc.simulator import Simulator  # pyright: ignore[reportMissingImports]
from measured_rows import beside_peer, gradient_speed
from numpy.typing import NDArray
from published_rows import Row

import jaxmuscle as jm
from jaxmuscle._config import cores
from jaxmuscle.tuning.evaluation import Evaluation
from jaxmuscle.tuning.tune import prepared

MANY, ROUNDS = 1000, 3
AGREEMENT = 1e-6
"""Largest difference of gradients, relative to their length, for two programs to have done the same."""


def thousand() -> tuple[Evaluation, Numbers, NDArray, NDArray, NDArray]:
    """The package's own evaluation, and what peers take: numbers, reference, inertias, noise."""
    joint, controller, scenarios = problem(6)
    inertias = np.linspace(0.5, 1.5, MANY) * float(joint.inertia)
    settings = {"start": scenarios[0].start, "noise": {"angle": 2e-4}}
    over = {"inertia": inertias.tolist()}
    many = jm.tuning.grid(scenarios[0].reference, TIMES, over, **settings)
    evaluation = prepared(joint, controller, many, SIZES)
    reference = np.stack([np.asarray(part) for part in scenarios[0].reference])
    noise = np.asarray(evaluation.stacked.cases.told.noise["angle"])
    return evaluation, Numbers(joint, controller, float(TIMES[1]), SIZES), reference, inertias, noise


def own_costs(evaluation: Evaluation) -> Callable[[], NDArray]:
    """Mean cost of all scenarios, and its gradient by the gains in SI."""
    at = evaluation.unknowns.coordinates(evaluation.unknowns.start)

    def call() -> NDArray:
        local = evaluation(at[None])[0]
        return np.append(local.cost, local.gradient / evaluation.unknowns.slopes(at))

    return call


def timed(call: Callable[[], NDArray], rounds: int = ROUNDS) -> tuple[NDArray, float, float]:
    """What a call gives, its first time and the shortest of the next [s]."""
    found, spent = np.zeros(0), []
    for _ in range(1 + rounds):
        begin = time.perf_counter()
        found = call()
        spent.append(time.perf_counter() - begin)
    return found, spent[0], min(spent[1:])


def in_do_mpc(n: Numbers, reference: NDArray, inertia: float, noise: NDArray) -> Callable[[], NDArray]:
    """One scenario in do-mpc's simulator: its discrete model is the sample that CasADi takes, slopes and all.

    do-mpc has no derivatives of a closed loop by gains of one's own controller; here they are states of the
    model, and the simulator makes its steps from Python, as its users have it.
    """
    whole, wanted, seen, inertias, gains, after, cost, (error, jump) = sample(n)
    count = reference.shape[1]
    model = Model("discrete", "SX")
    z = model.set_variable("_x", "z", whole.shape)
    told = model.set_variable("_tvp", "told", (5, 1))
    grown = cost + error / count + (1 - told[4]) * jump / (count - 1)
    step = ca.Function("step", [whole, wanted, seen, inertias, gains], [ca.densify(ca.vertcat(after, cost))])
    grow = ca.Function("grow", [whole, wanted, seen, inertias, gains, told], [ca.densify(grown)])
    given = z, told[:3], told[3], inertia, n.gains
    model.set_rhs("z", ca.vertcat(step(*given)[:-1, :], grow(*given, told)))
    model.setup()
    simulator = Simulator(model)
    simulator.settings.t_step = n.step
    values = simulator.get_tvp_template()
    row = [0]

    def at(_: float) -> Any:
        values["told"] = np.array([*reference[:, row[0]], noise[row[0]], float(row[0] == 0)])
        return values

    simulator.set_tvp_fun(at)
    simulator.setup()

    def call() -> NDArray:
        simulator.reset_history()
        simulator.x0 = np.zeros(whole.numel())
        for row[0] in range(count):
            simulator.make_step(np.zeros((0, 1)))
        ended: Any = simulator.x0
        return np.asarray(ended.cat, dtype=float).reshape(whole.shape, order="F")[-1]

    return call


def apart(one: NDArray, other: NDArray) -> float:
    """Largest difference of a cost and its gradient, relative to the largest of these numbers."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def speed_rows() -> Iterator[Row]:
    """Cost and gradient by six gains of 1,000 scenarios of 3 s: one compilation, then all cores."""
    evaluation, n, reference, inertias, noise = thousand()
    ours, first, next_ones = timed(own_costs(evaluation))
    yield from gradient_speed(MANY, first, next_ones)
    call = all_costs(n, reference, inertias, noise, cores())
    theirs, _, spent = timed(call)
    scaled = np.append(1.0, n.gains)  # gradients by the logarithms of the gains
    off = apart(scaled * theirs.mean(1), scaled * ours)
    yield from beside_peer("CasADi in C, threads", MANY, spent / next_ones, off, AGREEMENT)
    alone, _, one = timed(in_do_mpc(n, reference, float(inertias[0]), noise[0]), 1)
    off = apart(scaled * alone, scaled * theirs[:, 0])
    whole = one * MANY / cores()
    print(f"    one scenario in do-mpc: {one:.2f} s; all of them, shared evenly by {cores()} cores: "
          f"{whole:.0f} s")  # fmt: skip
    yield from beside_peer("do-mpc's simulator, a process a core", MANY, whole / next_ones, off, AGREEMENT)
