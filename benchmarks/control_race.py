"""Gradient descent through the loop beside methods without gradients, on one objective, from one start."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import cma
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optuna
from closed_loop_joint import AMBIENT, INERTIAS, begun
from measured_rows import faster
from published_rows import Row
from scipy.optimize import minimize

import jaxmuscle as jm
from jaxmuscle.control import PID, Reference
from jaxmuscle.estimation.starting_points import spread_starts
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE
from jaxmuscle.tuning.evaluation import Evaluation
from jaxmuscle.tuning.search import Search
from jaxmuscle.tuning.tune import prepared

TIMES = np.arange(0, 3, 2e-3)
SIZES = {"tracking": np.deg2rad(0.5), "variation": 3e6}
MOST = 1500
"""Costs that a method without gradients may ask for."""
NEAR = 1.02
"""Cost, over a goal, at which a method has arrived."""
STARTS = {3: 8, 6: 8, 31: 1}
"""Starts of the descent by the number of gains; a network begins where it is."""
SEEDS = (1, 2, 3)
RANGE = 3.0
"""Half the range in which Bayesian optimisation seeks each coordinate, about the start."""


class Race(NamedTuple):
    """One run of a method: costs in the order in which they were asked for, and when [s]."""

    costs: list[float]
    seconds: list[float]

    def until(self, goal: float) -> tuple[float, float]:
        """Costs asked for, and seconds, to a goal; infinite where it was not reached."""
        reached = np.flatnonzero(np.array(self.costs) <= goal)
        if not len(reached):
            return np.inf, np.inf
        return float(reached[0] + 1), self.seconds[int(reached[0])]


class Watched:
    """A function that writes down what it gave and when."""

    def __init__(self, function: Callable[[Any], float]) -> None:
        self.function, self.race, self.begin = function, Race([], []), time.perf_counter()

    def __call__(self, point: Any) -> float:
        cost = self.function(point)
        self.race.costs.append(cost)
        self.race.seconds.append(time.perf_counter() - self.begin)
        return cost


class Network(eqx.Module):
    """Six hidden units of tanh from error, its integral and its rate to the pressure difference [Pa]."""

    inner: eqx.nn.MLP

    def start(self) -> Any:
        return jnp.zeros(2)

    def update(self, state: Any, wanted: Any, measured: Any, step: Any) -> tuple[Any, Any]:
        error = wanted - measured
        grown = state[0] + step * error
        seen = jnp.stack([error / 0.1, grown / 0.1, (error - state[1]) / step / 2.0])
        return jnp.stack([grown, error]), 2e5 * self.inner(seen)


def network() -> Network:
    """One of 31 weights."""
    return Network(eqx.nn.MLP(3, "scalar", 6, 1, activation=jnp.tanh, key=jax.random.key(0)))


def problem(gains: int) -> tuple[Any, Any, list[jm.tuning.Scenario]]:
    """Joint 1 of [T] with two payloads under a PID (3 gains), its variable-structure controller (6) or a
    network (31).
    """
    joint = jm.robot.robot_joint(INERTIAS[0])
    angle, turn = 0.3 * (1 - np.cos(2 * TIMES)), 2.0
    rates = 0.3 * turn * np.sin(turn * TIMES), 0.3 * turn**2 * np.cos(turn * TIMES)
    kind: Any = PID
    rest = {"pressure": np.full(2, AMBIENT + MEAN_PRESSURE)}
    made: dict[int, Callable[[], Any]] = {
        3: lambda: kind(5e5, 5e5, 5e4),
        6: lambda: begun(INERTIAS[0], False)[0],
        31: network,
    }
    controller = made[gains]()
    reference: Any = Reference(angle, *rates) if gains == 6 else angle  # pyright: ignore[reportArgumentType]
    over = {"inertia": [INERTIAS[0], 1.5 * INERTIAS[0]]}
    return joint, controller, jm.tuning.grid(reference, TIMES, over, start=rest, noise={"angle": 2e-4})


def cost_of(evaluation: Evaluation) -> Callable[[Any], float]:
    """The cost at a point in the coordinates of the descent, without derivatives."""

    def cost(point: Any) -> float:
        found = evaluation.cost(
            evaluation.seen(evaluation.unknowns.values(np.asarray(point)), evaluation.rows)
        )
        return found if np.isfinite(found) else 1e9

    return cost


class Recorded(Evaluation):
    """An evaluation with derivatives that writes down what it gave and when."""

    def __call__(self, points: Any) -> list[Any]:
        found = super().__call__(points)
        RACE.costs.extend(local.cost if local.finite else np.inf for local in found)
        RACE.seconds.extend([time.perf_counter() - BEGIN[-1]] * len(found))
        return found


RACE, BEGIN = Race([], []), [0.0]
"""What the descent that is under way has asked for, and when it began."""


def descent(gains: int) -> Race:
    """Costs of the descent from as many starts as it takes by default, derivatives included."""
    plain = prepared(*problem(gains), SIZES)
    fields = {field.name: getattr(plain, field.name) for field in dataclasses.fields(plain)}
    evaluation = Recorded(**fields)
    evaluation(evaluation.unknowns.coordinates(evaluation.unknowns.start)[None])  # compiles
    RACE.costs.clear()
    RACE.seconds.clear()
    BEGIN.append(time.perf_counter())
    search = Search(evaluation, 100, np.inf, None, lambda message: None, BEGIN[-1])
    search.from_points(spread_starts(evaluation.unknowns, STARTS[gains], 0), ())
    return Race(list(RACE.costs), list(RACE.seconds))


def others(gains: int) -> dict[str, Race]:
    """Nelder and Mead's simplex, CMA-ES with several seeds, and Bayesian optimisation by tree-structured
    Parzen estimators, in the same coordinates.
    """
    evaluation = prepared(*problem(gains), SIZES)
    start, cost = evaluation.unknowns.coordinates(evaluation.unknowns.start), cost_of(evaluation)
    cost(start)  # compiles
    simplex = Watched(cost)
    minimize(simplex, start, method="Nelder-Mead", options={"maxfev": MOST, "xatol": 1e-3, "fatol": 1e-4})
    found = {"Nelder-Mead": simplex.race}
    for seed in SEEDS:
        own = Watched(cost)
        options = {"seed": seed, "maxfevals": MOST, "verbose": -9, "tolfun": 1e-4}
        cma.fmin2(own, start, 0.7, options)
        found[f"CMA-ES, seed {seed}"] = own.race
    found["TPE of optuna"] = bayesian(cost, start)
    return found


def bayesian(cost: Callable[[Any], float], start: Any) -> Race:
    """Tree-structured Parzen estimators of optuna, from the same start, within a box about it."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    own, names = Watched(cost), [f"u{i}" for i in range(len(start))]

    def of(trial: Any) -> float:
        about = zip(names, start, strict=True)
        return own([trial.suggest_float(name, u - RANGE, u + RANGE) for name, u in about])

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=SEEDS[0]))
    study.enqueue_trial(dict(zip(names, map(float, start), strict=True)))
    study.optimize(of, n_trials=MOST)
    return own.race


def race_rows() -> Iterator[Row]:
    """Evaluations and seconds to the same cost, with 3, 6 and 31 gains.

    Each other method has the goal that both it and the descent reach: the higher of their lowest costs.
    """
    for gains in (3, 6, 31):
        own, rivals = descent(gains), others(gains)
        print(f"    {gains} gains, descent: lowest cost {min(own.costs):.4g} in {len(own.costs)} "
              f"evaluations, {own.seconds[-1]:.2f} s")  # fmt: skip
        for name, race in rivals.items():
            goal = NEAR * max(min(race.costs), min(own.costs))
            print(f"    {gains} gains, {name}: lowest cost {min(race.costs):.4g} in {len(race.costs)} "
                  f"evaluations, {race.seconds[-1]:.2f} s; to {goal:.4g} in {race.until(goal)[0]:g}, "
                  f"the descent in {own.until(goal)[0]:g}")  # fmt: skip
            lead = min(own.costs) / min(race.costs)
            yield from faster(gains, name, own.until(goal), race.until(goal), lead)
