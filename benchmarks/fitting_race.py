"""Seconds to the same cost: this package, scipy with finite differences on it, and CasADi, in one run.

The lifting bench of the oracles, eight parameters, every one 20 % off at the start, priors of 10 %; from one
start, and from twenty (`fitting_starts.py`). All minimise one cost: the residuals of both links, window by
window, with the same weights, and the priors. All times are those of the minimisation alone, up to the first
point whose cost is within a thousandth of the worst of the minima found (from twenty starts, of our best): no
weights, no error of the solver, no covariance, by nobody. Cold, ours and scipy's begin with nothing compiled.

CasADi's derivatives are used by the package's own Gauss-Newton (Levenberg-Marquardt) method, which shows what
derivatives alone are worth, and by the trust region of scipy.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import fitting_hysteresis as hysteresis
import jax.numpy as jnp
import numpy as np
from fitting_cases import CASES
from numpy.typing import NDArray
from scipy.optimize import least_squares

from jaxmuscle.estimation.dataset import station
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.prepare import prepared
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
EQUAL = 1e-9
"""Relative difference that rounding may make."""
WARM_RUNS = 7

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


def race() -> list[dict[str, Any]]:
    """From one start cold, then warm, then from twenty, each against both others; and fifty parameters."""
    from fitting_casadi import CasadiLift
    from fitting_starts import many

    objective, start = task()
    # Nothing is compiled before these two.
    cold = {"ours": ours(objective, start), "scipy": scipys(objective, start)}
    model = CasadiLift(objective.stations[0])
    agree(objective, start, model)
    warm = {
        name: min((run(start) for _ in range(WARM_RUNS)), key=lambda t: t[-1][0])
        for name, run in runners(objective, model).items()
    }
    return [*rows(cold, warm), *many(objective, model), *fifty()]


def agree(objective: Objective, start: Vector, model: Any) -> None:
    """CasADi minimises the same cost, with the same derivatives."""
    mine, theirs = (
        objective.at(start[None])[0],
        local(objective.unknowns, start, *model(objective.unknowns.values(start))),
    )
    for name in ("cost", "gradient"):
        one, other = np.asarray(getattr(mine, name)), np.asarray(getattr(theirs, name))
        apart = np.abs(one - other).max() / np.abs(one).max()
        assert apart < EQUAL, f"{name} of CasADi and ours are {apart:.1e} apart"


def runners(objective: Objective, model: Any) -> dict[str, Callable[[Vector], Trace]]:
    """Who takes part: start → time and cost of each evaluation."""
    return {
        "ours": lambda u: ours(objective, u),
        "scipy": lambda u: scipys(objective, u),
        "casadi": lambda u: casadis(objective, u, model),
        "casadi, scipy's trust region": lambda u: trusting(objective, u, model),
    }


def fifty() -> list[dict[str, Any]]:
    """The fit of fifty parameters of hysteresis against scipy alone: what each derivative costs."""
    asked = Asked(["loops.weights", "loops.thresholds", "loops.stiffness"])
    objective = prepared(hysteresis.start(), [hysteresis.recording()], asked, None, None, Squares())
    start = objective.unknowns.coordinates(objective.unknowns.start)
    runners = {"ours": lambda: ours(objective, start), "scipy": lambda: scipys(objective, start)}
    cold = {name: run() for name, run in runners.items()}
    warm = {name: min((run() for _ in range(2)), key=lambda t: t[-1][0]) for name, run in runners.items()}
    found = []
    for state, traces in (("cold", cold), ("warm", warm)):
        common = until_the_target(traces)
        ratio = common["seconds"]["scipy"] / common["seconds"]["ours"]
        row = {"figure": f"fifty parameters: times faster than scipy, {state}", "goal": ">= 10",
               "ours": ratio, "ok": ratio >= 10, **common}  # fmt: skip
        why = (
            "compilation" if state == "cold" else f"{if_slopes_were_free(common):.1f} if slopes cost nothing"
        )
        found.append(row if row["ok"] else {**row, "why": why})
    return found


def until_the_target(traces: Mapping[str, Trace]) -> dict[str, Any]:
    """Seconds and evaluations until all have come to the worst of the minima, and where they ended."""
    target = max(trace[-1][1] for trace in traces.values()) * (1 + SAME)
    there = {
        name: next(i for i, (_, cost) in enumerate(trace) if cost <= target) for name, trace in traces.items()
    }
    return {
        "seconds": {name: traces[name][i][0] for name, i in there.items()},
        "evaluations": {name: i + 1 for name, i in there.items()},
        "final_costs": {name: trace[-1][1] for name, trace in traces.items()},
    }


def if_slopes_were_free(common: Mapping[str, Any]) -> float:
    """Runs of scipy for each evaluation of ours: how many times faster ours would be if an evaluation with
    slopes took no longer than a run, and steps took nothing on either side.
    """
    return common["evaluations"]["scipy"] / common["evaluations"]["ours"]


def rows(cold: dict[str, Trace], warm: dict[str, Trace]) -> list[dict[str, Any]]:
    first, later = until_the_target(cold), until_the_target(warm)
    casadi = min(value for name, value in later["seconds"].items() if "casadi" in name)
    mine, evaluations = later["seconds"]["ours"], later["evaluations"]
    each = f"{evaluations['ours']} evaluations of ours, {evaluations['casadi']} of CasADi's"
    free = f"{if_slopes_were_free(later):.1f} if slopes cost nothing"
    compiling = first["seconds"]["scipy"] / first["seconds"]["ours"]
    told = (
        ("scipy with finite differences, cold", compiling, 10, first,
         "one compilation of derivatives costs more than it saves here"),
        ("scipy with finite differences, warm", later["seconds"]["scipy"] / mine, 10, later, free),
        ("CasADi, warm", casadi / mine, 1, later, each),
    )  # fmt: skip
    found = []
    for who, ratio, goal, common, why in told:
        row = {"figure": f"times faster than {who}", "goal": f">= {goal}", "ours": ratio, "ok": ratio >= goal}
        found.append({**row, **common} | ({} if row["ok"] else {"why": why}))
    return found


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
