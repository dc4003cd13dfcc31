"""Seconds to the same cost: this package, scipy with finite differences on it, and CasADi, in one run.

The lifting bench of the oracles, eight parameters, every one 20 % off at the start, priors of 10 %. All
minimise one cost: the residuals of both links, window by window, with the same weights, and the priors.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from fitting_cases import CASES
from numpy.typing import NDArray
from scipy.optimize import least_squares

from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import Limits
from jaxmuscle.estimation.layout import Asked, layout
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Local, Objective
from jaxmuscle.estimation.slopes import residual_vector
from jaxmuscle.estimation.stations import station
from jaxmuscle.parameters import get

FREE = ("valve_area", "valve_time_constant", "polytropic_exponent", "initial_radius", "end_factor", "mass",
        "supply_pressure", "load_damping.coefficient")  # fmt: skip
OFF = 0.2
PRIOR = 0.1
SAME = 1e-3
"""Relative difference of two costs up to which they are the same."""
WARM_RUNS = 5

Trace = list[tuple[float, float]]
Vector = NDArray[np.float64]


def task() -> tuple[Objective, Vector]:
    """The cost, and where everybody starts."""
    case = CASES["isotonic"]
    recording, machine = case.recording(0), case.machine
    paths = {name: machine.quantities.get(name, f"effects.{name}") for name in FREE}
    true = {name: float(get(machine, path)) for name, path in paths.items()}
    priors = {name: (value, PRIOR * value) for name, value in true.items()}
    unknowns = layout(machine, [recording], ["lift"], Asked(FREE, priors=priors))
    objective = Objective([station(machine, recording, "lift", None, {})], unknowns, Squares())
    signs = np.random.default_rng(4).choice([-1, 1], size=len(FREE))
    return objective, unknowns.coordinates(unknowns.start * (1 + OFF * signs))


def race() -> list[dict[str, Any]]:
    """Cold, then warm; each against both others."""
    from fitting_casadi import CasadiLift

    objective, start = task()
    runners: dict[str, Callable[[], Trace]] = {
        "ours": lambda: ours(objective, start),
        "scipy": lambda: scipys(objective, start),
    }
    cold = {name: run() for name, run in runners.items()}
    for name, compiled in (("casadi", False), ("casadi, compiled with gcc", True)):
        model = CasadiLift(objective.stations[0], compiled)
        cold[name] = casadis(objective, start, model, model.seconds)
        runners[name] = lambda m=model: casadis(objective, start, m)
    warm = {
        name: min((run() for _ in range(WARM_RUNS)), key=lambda t: t[-1][0]) for name, run in runners.items()
    }
    return [*rows("cold", cold), *rows("warm", warm)]


def rows(state: str, traces: dict[str, Trace]) -> list[dict[str, Any]]:
    target = max(trace[-1][1] for trace in traces.values()) * (1 + SAME)
    seconds = {name: next(t for t, cost in trace if cost <= target) for name, trace in traces.items()}
    best = min(value for name, value in seconds.items() if "casadi" in name)
    mine, scipy = seconds["ours"], seconds["scipy"]
    costs = {name: trace[-1][1] for name, trace in traces.items()}
    common = {"seconds": seconds, "final_costs": costs}
    found = [{"figure": f"times faster than scipy with finite differences, {state}", "goal": ">= 10",
              "ours": scipy / mine, "ok": scipy >= 10 * mine, **common,
              "why": "one compilation of derivatives costs more than it saves here" if state == "cold" else
                     "a Jacobian by finite differences costs nine runs here, ours as many tangents"},
             {"figure": f"times faster than CasADi, {state}",
              "goal": ">= 1" if state == "warm" else "none is set", "ours": best / mine,
              "ok": state == "cold" or best >= mine, **common,
              "why": "the step of a small model is faster as straight C than as batched XLA"}]  # fmt: skip
    return [{k: v for k, v in row.items() if k != "why" or not row["ok"]} for row in found]


def ours(objective: Objective, start: Vector) -> Trace:
    return _descended(objective.at, objective, start)


def casadis(objective: Objective, start: Vector, model: Any, before: float = 0.0) -> Trace:
    """CasADi's residuals and slopes under the same Levenberg-Marquardt; `before`: seconds to build it."""
    unknowns = objective.unknowns

    def at(points: NDArray[np.float64]) -> list[Local]:
        (u,) = points
        r, jacobian = model(unknowns.values(u))
        slopes, prior, steep = (
            jacobian * unknowns.slopes(u),
            unknowns.prior_residuals(u),
            unknowns.prior_slopes,
        )
        cost = 0.5 * float(r @ r + prior @ prior)
        return [Local(cost, slopes.T @ r + prior * steep, slopes.T @ slopes + np.diag(steep**2), 0)]

    return _descended(at, objective, start, before)


def _descended(at: Any, objective: Objective, start: Vector, before: float = 0.0) -> Trace:
    begin, trace, unknowns = time.perf_counter(), [], objective.unknowns
    limits = Limits(unknowns.lower, unknowns.upper, 60, 1, samples=objective.samples)
    note = lambda course: trace.append((before + time.perf_counter() - begin, course.cost))  # noqa: E731
    descend(at, start[None], limits, tell=note)
    return trace


@eqx.filter_jit
def _values(theta, actuator, problem, paths):
    return residual_vector(theta, actuator, problem, paths)


def scipys(objective: Objective, start: Vector) -> Trace:
    begin, trace, unknowns, place = time.perf_counter(), [], objective.unknowns, objective.stations[0]
    paths = tuple(entry.place.path for entry in unknowns.entries)

    def residuals(u: Vector) -> Vector:
        r = np.asarray(_values(jnp.asarray(unknowns.values(u)), place.actuator, place.problem, paths))
        whole = np.concatenate([r, unknowns.prior_residuals(u)])
        cost = 0.5 * float(whole @ whole)
        trace.append((time.perf_counter() - begin, min(cost, trace[-1][1] if trace else np.inf)))
        return whole

    least_squares(residuals, start, jac="2-point", x_scale="jac", method="trf")
    return trace
