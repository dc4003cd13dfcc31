"""Task of the race of `fitting_race.py`, and everybody's way down to its minimum."""

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

from jaxmuscle.estimation.dataset import station
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.residuals import residual_vector
from jaxmuscle.optimization.descents import Limits, Local
from jaxmuscle.optimization.levenberg_marquardt import descend
from jaxmuscle.parameters import get

FREE = ("valve_area", "valve_time_constant", "polytropic_exponent", "initial_radius", "end_factor", "mass",
        "supply_pressure", "load_damping.coefficient")  # fmt: skip
OFF = 0.2
PRIOR = 0.1
SAME = 1e-3
"""Relative difference of two costs up to which they are the same."""

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
    return objective, unknowns.coordinates(np.asarray(unknowns.start * (1 + OFF * signs), dtype=np.float64))


def runners(objective: Objective, model: Any) -> dict[str, Callable[[Vector], Trace]]:
    """Who takes part: start → time and cost of each evaluation."""
    return {
        "ours": lambda u: ours(objective, u),
        "scipy": lambda u: scipys(objective, u),
        "casadi": lambda u: casadis(objective, u, model),
        "casadi, scipy's trust region": lambda u: trusting(objective, u, model),
    }


def ours(objective: Objective, start: Vector) -> Trace:
    return _descended(objective.at, objective, start)


def casadis(objective: Objective, start: Vector, model: Any) -> Trace:
    """CasADi's residuals and slopes under the package's own descent."""
    unknowns = objective.unknowns
    at = lambda points: [local(unknowns, points[0], *model(unknowns.values(points[0])))]  # noqa: E731
    return _descended(at, objective, start)


def local(unknowns: Any, u: Vector, r: Vector, jacobian: NDArray[np.float64]) -> Local:
    """Cost, gradient and curvature from residuals and their slopes by the values."""
    slopes, prior, steep = jacobian * unknowns.slopes(u), unknowns.prior_residuals(u), unknowns.prior_slopes
    cost = 0.5 * float(r @ r + prior @ prior)
    return Local(cost, slopes.T @ r + prior * steep, slopes.T @ slopes + np.diag(steep**2), 0)


def _descended(at: Any, objective: Objective, start: Vector) -> Trace:
    begin, trace, unknowns = time.perf_counter(), [], objective.unknowns
    limits = Limits(unknowns.lower, unknowns.upper, 60, 1, samples=objective.samples, reach=unknowns.reach)
    note = lambda course: trace.append((time.perf_counter() - begin, course.cost))  # noqa: E731
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


def trusting(objective: Objective, start: Vector, model: Any) -> Trace:
    """CasADi's residuals and slopes under scipy's least_squares."""
    begin, trace, unknowns = time.perf_counter(), [], objective.unknowns
    last: dict[str, Any] = {}

    def at(u: Vector) -> tuple[Vector, NDArray[np.float64]]:
        if not np.array_equal(last.get("u", np.zeros(0)), u):
            r, jacobian = model(unknowns.values(u))
            whole = np.concatenate([r, unknowns.prior_residuals(u)])
            slopes = np.vstack([jacobian * unknowns.slopes(u), np.diag(unknowns.prior_slopes)])
            last.update(u=u.copy(), found=(whole, slopes))
            cost = 0.5 * float(whole @ whole)
            passed = time.perf_counter() - begin
            trace.append((passed, min(cost, trace[-1][1] if trace else np.inf)))
        return last["found"]

    slopes: Any = lambda u: at(u)[1]  # noqa: E731
    least_squares(lambda u: at(u)[0], start, slopes, x_scale="jac", method="trf")
    return trace
