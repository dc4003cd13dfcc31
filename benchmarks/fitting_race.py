"""Seconds to the same cost: this package, scipy with finite differences on it, and CasADi, in one run.

The lifting bench of the oracles, eight parameters, every one 20 % off at the start, priors of 10 %; from one
start, and from twenty, which this package brings down together. All
minimise one cost: the residuals of both links, window by window, with the same weights, and the priors.
All times are those of the minimisation alone, up to the first point whose cost is within a thousandth of the
worst of the minima found (from twenty starts, of our best): no weights, no error of the solver, no
covariance, by nobody. Cold, ours and scipy's begin with nothing compiled, CasADi's with nothing built.

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

from jaxmuscle.cores import cores
from jaxmuscle.estimation.arguments import prepared
from jaxmuscle.estimation.asked import Asked
from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import Limits
from jaxmuscle.estimation.layout import layout
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Local, Objective
from jaxmuscle.estimation.search import side_by_side
from jaxmuscle.estimation.slopes import residual_vector
from jaxmuscle.estimation.stations import station
from jaxmuscle.parameters import get

FREE = ("valve_area", "valve_time_constant", "polytropic_exponent", "initial_radius", "end_factor", "mass",
        "supply_pressure", "load_damping.coefficient")  # fmt: skip
OFF = 0.2
PRIOR = 0.1
SAME = 1e-3
"""Relative difference of two costs up to which they are the same."""
WARM_RUNS, MANY_RUNS = 7, 3
STARTS = 20

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
    runners: dict[str, Callable[[Vector], Trace]] = {
        "ours": lambda u: ours(objective, u),
        "scipy": lambda u: scipys(objective, u),
    }
    cold = {name: run(start) for name, run in runners.items()}
    for name, compiled in (("casadi", False), ("casadi, compiled with gcc", True)):
        model = CasadiLift(objective.stations[0], compiled)
        cold[name] = casadis(objective, start, model, model.seconds)
        runners[name] = lambda u, m=model: casadis(objective, u, m)
        runners[f"{name}, scipy's trust region"] = lambda u, m=model: trusting(objective, u, m)
        cold[f"{name}, scipy's trust region"] = trusting(objective, start, model, model.seconds)
    warm = {
        name: min((run(start) for _ in range(WARM_RUNS)), key=lambda t: t[-1][0])
        for name, run in runners.items()
    }
    return [*rows("cold", cold), *rows("warm", warm), *many(objective, runners), *fifty()]


def many(objective: Objective, runners: Mapping[str, Callable[[Vector], Trace]]) -> list[dict[str, Any]]:
    """Twenty starts, warm: ours all at once, the others one after the other.

    Time counts until each start has come to the common minimum, or to its end where it does not come there.
    """
    starts, unknowns = scattered(objective), objective.unknowns
    objective = side_by_side(objective, len(starts))
    limits = Limits(unknowns.lower, unknowns.upper, 60, len(starts), samples=objective.samples,
                    reach=unknowns.reach)  # fmt: skip
    ended = descend(objective.at, starts, limits)
    best = min(lane.cost for lane in ended)
    target = best * (1 + SAME)
    seconds = {"ours": min(together(objective, starts, limits, target) for _ in range(MANY_RUNS))}
    arrived = {"ours": sum(lane.cost <= target for lane in ended)}
    for name, run in runners.items():
        if name != "ours":
            traces = []
            for _ in range(MANY_RUNS):
                traces = [run(start) for start in starts]
                ends = [next((t for t, c in trace if c <= target), trace[-1][0]) for trace in traces]
                seconds[name] = min(seconds.get(name, np.inf), sum(ends))
            arrived[name] = sum(trace[-1][1] <= target for trace in traces)
    quickest = min(value for name, value in seconds.items() if "casadi" in name)
    found = []
    for who, ratio, goal in (("scipy", seconds["scipy"], 10), ("CasADi", quickest, 1)):
        row = {"figure": f"{len(starts)} starts: times faster than {who}, warm", "goal": f">= {goal}",
               "ours": ratio / seconds["ours"], "ok": ratio >= goal * seconds["ours"], "seconds": seconds,
               "told": f"ours on {cores()} cores, the others on one", "arrived": arrived}  # fmt: skip
        found.append(
            row if row["ok"] else {**row, "why": "beside each evaluation a start takes a step in NumPy"}
        )
    return found


def together(objective: Objective, starts: NDArray[np.float64], limits: Limits, target: float) -> float:
    """Seconds until the last start has come to this cost; all are under way from the beginning."""
    assert limits.lanes >= len(starts), "a cost of every start belongs to every round"
    begin, stamps = time.perf_counter(), []
    lanes = descend(objective.at, starts, limits, tell=lambda _: stamps.append(time.perf_counter() - begin))
    rounds = [
        next((i for i, c in enumerate(lane.costs) if c <= target), len(lane.costs) - 1) for lane in lanes
    ]
    return stamps[max(rounds)]


def scattered(objective: Objective) -> NDArray[np.float64]:
    """Starts with every parameter 20 % too small or too large."""
    signs = np.random.default_rng(5).choice([-1, 1], size=(STARTS, len(FREE)))
    return np.stack([objective.unknowns.coordinates(objective.unknowns.start * (1 + OFF * s)) for s in signs])


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


def rows(state: str, traces: dict[str, Trace]) -> list[dict[str, Any]]:
    common = until_the_target(traces)
    seconds = common["seconds"]
    best = min(value for name, value in seconds.items() if "casadi" in name)
    mine, scipy = seconds["ours"], seconds["scipy"]
    warm = state == "warm"
    found = [{"figure": f"times faster than scipy with finite differences, {state}", "goal": ">= 10",
              "ours": scipy / mine, "ok": scipy >= 10 * mine, **common,
              "why": f"{if_slopes_were_free(common):.1f} if slopes cost nothing" if warm else
                     "one compilation of derivatives costs more than it saves here"},
             {"figure": f"times faster than CasADi, {state}",
              "goal": ">= 1" if warm else "none is set", "ours": best / mine,
              "ok": not warm or best >= mine, **common,
              "why": "its step is straight C with the sensitivities written out"}]  # fmt: skip
    return [{k: v for k, v in row.items() if k != "why" or not row["ok"]} for row in found]


def ours(objective: Objective, start: Vector) -> Trace:
    return _descended(objective.at, objective, start)


def casadis(objective: Objective, start: Vector, model: Any, before: float = 0.0) -> Trace:
    """CasADi's residuals and slopes; `before`: seconds to build it."""
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
    limits = Limits(unknowns.lower, unknowns.upper, 60, 1, samples=objective.samples, reach=unknowns.reach)
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


def trusting(objective: Objective, start: Vector, model: Any, before: float = 0.0) -> Trace:
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
            passed = before + time.perf_counter() - begin
            trace.append((passed, min(cost, trace[-1][1] if trace else np.inf)))
        return last["found"]

    slopes: Any = lambda u: at(u)[1]  # noqa: E731
    least_squares(lambda u: at(u)[0], start, slopes, x_scale="jac", method="trf")
    return trace
