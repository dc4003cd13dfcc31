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

from collections.abc import Mapping
from typing import Any

import fitting_hysteresis as hysteresis
import numpy as np
from fitting_descents import SAME, Trace, Vector, local, ours, runners, scipys, task

from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.prepare import prepared
from jaxmuscle.estimation.request import Asked

EQUAL = 1e-9
"""Relative difference that rounding may make."""
WARM_RUNS = 7


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


def fifty() -> list[dict[str, Any]]:
    """The fit of fifty parameters of hysteresis against scipy alone: what each derivative costs."""
    asked = Asked(["loops.weights", "loops.thresholds", "loops.stiffness"])
    objective = prepared(hysteresis.start(), [hysteresis.recording()], asked, None, None, Squares())
    start = objective.unknowns.coordinates(objective.unknowns.start)
    both = {"ours": lambda: ours(objective, start), "scipy": lambda: scipys(objective, start)}
    cold = {name: run() for name, run in both.items()}
    warm = {name: min((run() for _ in range(2)), key=lambda t: t[-1][0]) for name, run in both.items()}
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
