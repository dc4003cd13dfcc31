"""Twenty starts of the race of `fitting_race.py`, everybody on all cores.

This package brings them down together. CasADi is tried in three ways, of which the fastest counts: all starts
together by the package's own descent, its evaluations on threads; each start for itself in a pool of
processes, by the same descent and by scipy's trust region. scipy with differences runs in such a pool.

Time counts until each start has come to the common minimum, or to its end where it does not come there. Of a
pool it is that of its processes alone, as if they fetched one start after the other without any delay.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
from fitting_casadi import CasadiLift
from fitting_descents import FREE, OFF, SAME, Trace, Vector, local, runners, task
from numpy.typing import NDArray

from jaxmuscle._config import cores
from jaxmuscle.estimation.multistart import side_by_side
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.optimization.descents import Limits, Local
from jaxmuscle.optimization.levenberg_marquardt import descend

MANY_RUNS = 3
STARTS = 20
Points = NDArray[np.float64]


def many(objective: Objective, model: CasadiLift) -> list[dict[str, Any]]:
    """Twenty starts, warm."""
    starts, unknowns = scattered(objective), objective.unknowns
    limits = Limits(unknowns.lower, unknowns.upper, 60, len(starts), samples=objective.samples,
                    reach=unknowns.reach)  # fmt: skip
    evaluations: dict[str, Callable[[Points], list[Local]]] = {
        "ours": side_by_side(objective, len(starts)).at,
        "casadi, threads": lambda points: several(objective, model, points),
    }
    ended = {name: descend(at, starts, limits) for name, at in evaluations.items()}
    target = min(lane.cost for lane in ended["ours"]) * (1 + SAME)
    seconds = {
        name: min(together(at, starts, limits, target) for _ in range(MANY_RUNS))
        for name, at in evaluations.items()
    }
    arrived = {name: sum(lane.cost <= target for lane in lanes) for name, lanes in ended.items()}
    with ProcessPoolExecutor(cores(), get_context("spawn"), warmed, (starts[0],)) as pool:
        for name in (name for name in runners(objective, model) if name != "ours"):
            for _ in range(MANY_RUNS):
                traces = list(pool.map(one, [name] * len(starts), starts))
                ends = [next((t for t, c in trace if c <= target), trace[-1][0]) for trace in traces]
                seconds[f"{name}, processes"] = min(
                    seconds.get(f"{name}, processes", np.inf), shared_out(ends, cores())
                )
                arrived[f"{name}, processes"] = sum(trace[-1][1] <= target for trace in traces)
    each = {name: f"{name} {1e3 * took / len(starts):.2f}" for name, took in seconds.items()}
    found = []
    for who, goal in (("scipy", 10), ("casadi", 1)):
        quickest = min((name for name in seconds if name.startswith(who)), key=lambda name: seconds[name])
        ratio = seconds[quickest] / seconds["ours"]
        row = {
            "figure": f"{len(starts)} starts, all cores: times faster than {quickest}", "goal": f">= {goal}",
            "ours": ratio, "ok": ratio >= goal, "seconds": seconds, "arrived": arrived,
            "told": f"arrived of {len(starts)}: " + ", ".join(f"{who} {n}" for who, n in arrived.items()),
        }  # fmt: skip
        why = f"milliseconds a start: {each['ours']}, {each[quickest]}"
        found.append(row if row["ok"] else {**row, "why": why})
    return found


def together(at: Callable[[Points], list[Local]], starts: Points, limits: Limits, target: float) -> float:
    """Seconds until the last start has come to this cost; all are under way from the beginning."""
    assert limits.lanes >= len(starts), "a cost of every start belongs to every round"
    begin, stamps = time.perf_counter(), []
    lanes = descend(at, starts, limits, tell=lambda _: stamps.append(time.perf_counter() - begin))
    rounds = [
        next((i for i, c in enumerate(lane.costs) if c <= target), len(lane.costs) - 1) for lane in lanes
    ]
    return stamps[max(rounds)]


def several(objective: Objective, model: CasadiLift, points: Points) -> list[Local]:
    """CasADi's residuals and slopes of several points at once."""
    unknowns = objective.unknowns
    found = model.several(np.stack([unknowns.values(u) for u in points]))
    return [local(unknowns, u, r, slopes) for u, (r, slopes) in zip(points, found, strict=True)]


def shared_out(seconds: list[float], workers: int) -> float:
    """When the last of some workers is done, of whom each takes the next piece as soon as it is free."""
    free = [0.0] * workers
    for piece in seconds:
        free[free.index(min(free))] += piece
    return max(free)


def scattered(objective: Objective) -> Points:
    """Starts with every parameter 20 % too small or too large."""
    signs = np.random.default_rng(5).choice([-1, 1], size=(STARTS, len(FREE)))
    return np.stack([objective.unknowns.coordinates(objective.unknowns.start * (1 + OFF * s)) for s in signs])


@functools.cache
def prepared() -> dict[str, Callable[[Vector], Trace]]:
    """Everybody's descent, once in each process."""
    objective, _ = task()
    return runners(objective, CasadiLift(objective.stations[0]))


def warmed(start: Vector) -> None:
    """Begin a process: everything is compiled before a start counts."""
    for name, run in prepared().items():
        if name != "ours":
            run(start)


def one(name: str, start: Vector) -> Trace:
    """One start in a process of a pool."""
    return prepared()[name](start)
