"""Tuning of a controller by gradient descent through the whole closed loop (`jaxmuscle.tune`)."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle._config import require_double_precision
from jaxmuscle._memory_areas import make_room_for_programs
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.digital import check_clocks
from jaxmuscle.control.feedback import Attached, feedback_on
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.estimation.request import Bounds, factors, seconds, whole
from jaxmuscle.estimation.starting_points import given_starts, spread_starts
from jaxmuscle.optimization.descents import best
from jaxmuscle.tuning.cases import Stacked, stacked
from jaxmuscle.tuning.cost_terms import Given, Objective, sizes_of
from jaxmuscle.tuning.evaluation import Evaluation, Rig
from jaxmuscle.tuning.gains import gains_of
from jaxmuscle.tuning.result_assembly import concluded
from jaxmuscle.tuning.scenarios import Scenario, with_delays
from jaxmuscle.tuning.search import Search
from jaxmuscle.tuning.tuning_result import Tuning

SMALL = 0.01
"""Root mean square error that costs one where no objective is given, of the range of the references."""


def _silent(message: str) -> None:
    """Progress that goes nowhere."""


def tune(
    actuator: AbstractActuator,
    controller: Any,
    scenarios: Scenario | Sequence[Scenario],
    objective: Given | None = None,
    *,
    held_out: Sequence[Scenario] = (),
    free: Sequence[str] | None = None,
    bounds: Mapping[str, Bounds] | None = None,
    worst: float = 1.0,
    starts: int | Sequence[Mapping[str, float]] = 8,
    continuation: Sequence[float] = (),
    reading: str | None = None,
    budget: float | None = None,
    steps: int = 50,
    seed: int = 0,
    solver: object = None,
    progress: Callable[[str], None] = _silent,
) -> Tuning:
    r"""Tune a controller by gradient descent through valve, gas, muscle, load and sampled controller.

    All scenarios run side by side. The cost of one is :math:`c = \sum_i (v_i/s_i)^2`, v_i the value of a
    term and s_i the size of it that costs one; that of all :math:`(\frac1n \sum c^p)^{1/p}`, p = `worst`.
    Up to 60 gains are moved by the Gauss-Newton method within a trust region, with derivatives of all
    residuals from forward passes; more, or under a cost that is one number, by BFGS, with gradients from one
    pass back. Scenarios that are held out take no part in it and have the last word.

    :mod:`jaxmuscle.tuning` shows a whole script.

    Args:
        controller: of one reading, which :func:`~jaxmuscle.control.feedback_on` puts on the rig's channel; an
            :class:`~jaxmuscle.control.Attached`; or one of the whole machine, as
            :func:`~jaxmuscle.control.closed_loop` takes it, on a rig without a channel or with a class
            variable `of_all_readings` that is true. Any `eqx.Module` will do, a network too.
        scenarios: on which it is tuned; :func:`~jaxmuscle.tuning.grid` and :func:`~jaxmuscle.tuning.drawn`
            make many.
        objective: term → its size that costs one, in SI, of "tracking" (root mean square error), "peak"
            (largest error), "overshoot", "settling" [s], "arrival" (error over the last tenth), "effort"
            (root mean square of the command's distance from rest), "variation" (of its rate) and
            "sensitivity" (1 over the modulus margin of the loop, linearised at rest under an output of zero
            and without dry friction: :func:`~jaxmuscle.control.margins`; infinite of an unstable loop, so
            that gains with which it is stable are kept to wherever there are any); or a function
            (run, reference), or (run, reference, machine of the scenario) → residuals, whose squares add up
            to the cost of a scenario, or that cost as one number, not below zero. By default tracking, 1 %
            of the range of the references.
        held_out: scenarios for the last word.
        free: gains that are tuned, entries of arrays as ``layers[0].weight[1,2]``; when `None` those that
            the controller names in `gains`, without parameters that are zero, else all its arrays.
        bounds: gain → (lower, upper) in SI, `None` on a side without one. A gain that is declared positive
            or not negative keeps its sign without them.
        worst: p, at least 1: the mean at 1, ever more the worst scenario beyond (8 is near it).
        starts: how many (the controller's own, then a Latin hypercube about it), or the gains of each. With
            gains at which friction holds the machine there are no slopes: one start may not be enough.
        continuation: factors by which dry friction is smoothed more widely at first, from wide to narrow,
            ``(30, 6)``, where stick-slip makes the cost rugged. What friction holds throughout has no slopes
            by that either; more starts help.
        reading: that follows the reference, where the controller is of the whole machine.
        budget: seconds of search, after which the best so far is returned; compilation is not interrupted.
        steps, seed: most steps of a start; seed of the Latin hypercube.
        solver: of optimistix, in place of these two, as for :func:`jaxmuscle.fit`.
        progress: called with a line of text at every iteration.

    Raises:
        InputError: an unknown gain, term, parameter or reading, bounds without the start, a reference beyond
            what the machine can reach or of the wrong length, a controller whose output has the wrong shape,
            a loop that runs away wherever it is begun.
    """
    require_double_precision("tuning")
    make_room_for_programs()
    begin = time.monotonic()
    steps, seed = whole(steps, "steps", 1), whole(seed, "seed", 0)
    deadline, wide = begin + seconds(budget, "budget"), factors(continuation, "continuation")
    evaluation = prepared(
        actuator, controller, scenarios, objective, held_out, free, bounds, worst, bool(wide), reading
    )
    points = _points(evaluation.unknowns, starts, seed)
    search = Search(evaluation, steps, deadline, solver, progress, begin)
    lanes = search.from_points(points, wide)
    asked = {
        "bounds": {name: list(pair) for name, pair in (bounds or {}).items()},
        "worst": float(worst),
        "starts": starts if isinstance(starts, int) else [dict(point) for point in starts],
        "continuation": list(wide),
        "budget": budget,
        "steps": steps,
        "seed": seed,
        "solver": None if solver is None else type(solver).__name__,
    }
    settings = {**_settled(evaluation), **asked}
    passed = time.monotonic() - begin
    return concluded(search.evaluation, best(lanes), search.told, search.count, passed, controller, settings)


def _settled(evaluation: Evaluation) -> dict[str, Any]:
    """What a request came to: the controller's class, the objective, the reading, the step [s]."""
    goal, inner = evaluation.rig.objective, evaluation.rig.controller.controller
    sizes = {name: float(size) for name, size in goal.sizes.items()}
    return {
        "controller": type(inner).__name__,
        "objective": getattr(goal.function, "__name__", "a function") if goal.function else sizes,
        "reading": goal.reading,
        "step": evaluation.rig.step,
    }


def prepared(
    actuator: AbstractActuator,
    controller: Any,
    scenarios: Scenario | Sequence[Scenario],
    objective: Given | None = None,
    held_out: Sequence[Scenario] = (),
    free: Sequence[str] | None = None,
    bounds: Mapping[str, Bounds] | None = None,
    worst: float = 1.0,
    widened: bool = False,
    reading: str | None = None,
) -> Evaluation:
    """What :func:`tune` minimises, as a function of coordinates; arguments and errors are its own.

    `widened`: whether dry friction can be smoothed more widely.
    """
    if not (isinstance(worst, int | float) and 1 <= worst < math.inf):
        raise InputError(f"worst: expected a number from 1 (the mean) on; got {worst!r}")
    training, unseen = _scenarios(scenarios, "scenarios"), _scenarios(held_out, "held_out")
    if not training:
        raise InputError("scenarios: expected at least one scenario; got none")
    inner, attached = _attached(actuator, controller)
    followed = _reading(actuator, inner, attached, reading)
    where = [
        f"{name}[{i}]"
        for name, own in (("scenarios", training), ("held_out", unseen))
        for i in range(len(own))
    ]
    actuator, delayed = with_delays(actuator, [*training, *unseen], where)
    all_of_them = stacked(actuator, delayed, followed, where)
    check_clocks(inner, all_of_them.step)
    gains = gains_of(inner, free, bounds)
    rows = tuple(range(len(training)))
    rest = getattr(inner if attached is None else attached, "rest", jnp.zeros(()))
    goal = _objective(objective, all_of_them, rows, followed, rest)
    if goal.margin:
        if attached is None:
            raise InputError("objective: the sensitivity is that of a controller of one reading")
        all_of_them = all_of_them.linearised(actuator, attached)
    rig = Rig(
        actuator,
        gains.movable,
        attached,
        goal,
        jnp.ones(()) if widened else None,
        all_of_them.step,
        all_of_them.samples,
    )
    rig = dataclasses.replace(rig, objective=_with_form(rig, all_of_them))
    return Evaluation(rig, gains.unknowns, all_of_them, rows, float(worst))


def _scenarios(given: Any, where: str) -> list[Scenario]:
    listed = [given] if isinstance(given, Scenario) else list(given)
    for number, each in enumerate(listed):
        if not isinstance(each, Scenario):
            raise InputError(
                f"{where}[{number}]: expected a jaxmuscle.tuning.Scenario; got {type(each).__name__}"
            )
    return listed


def _attached(actuator: AbstractActuator, controller: Any) -> tuple[Any, Attached | None]:
    """What is tuned, and its attachment if it is of one reading."""
    if isinstance(controller, Attached):
        return controller.controller, controller
    for method in ("start", "update"):
        if not callable(getattr(controller, method, None)):
            raise InputError(
                "controller: expected an object with the methods start and update; got "
                f"{type(controller).__name__}"
            )
    if actuator.channel is None or getattr(controller, "of_all_readings", False):
        return controller, None
    return controller, feedback_on(actuator, controller)


def _reading(
    actuator: AbstractActuator, controller: Any, attached: Attached | None, given: str | None
) -> str | None:
    """The reading that follows the reference."""
    if attached is not None:
        return attached.reading
    if given is not None and given not in actuator.outputs:
        raise InputError(f"reading: unknown reading {given!r}{nearest(given, actuator.outputs)}")
    if given is None and actuator.channel is not None:
        return actuator.channel.reading
    return getattr(controller, "reading", None) if given is None else given


def _objective(
    given: Given | None,
    scenarios: Stacked,
    rows: Sequence[int],
    reading: str | None,
    rest: Array,
) -> Objective:
    if callable(given):
        short = ~np.asarray(scenarios.cases.counts).all()
        if short:
            raise InputError("objective: a function takes scenarios of one length; shorten the longer ones")
        return Objective({}, given, reading, rest)
    if reading is None:
        raise InputError(
            "reading: expected the name of the reading that follows the reference, as the controller is of "
            "the whole machine; or an objective that is a function"
        )
    if given is None:
        targets = np.asarray(target_of(scenarios.cases.told.reference))[list(rows)]
        size = SMALL * np.ptp(np.append(targets.ravel(), 0.0))
        given = {"tracking": float(size) or 1.0}
    if not isinstance(given, Mapping):
        raise InputError(f"objective: expected a mapping of terms to sizes, or a function; got {given!r}")
    sizes = {name: jnp.asarray(size) for name, size in sizes_of(given).items()}
    return Objective(sizes, None, reading, rest)


def _with_form(rig: Rig, scenarios: Stacked) -> Objective:
    """The objective, which knows now whether its cost is a sum of squares; a first look at the loop."""
    case = jax.tree.map(lambda leaf: leaf[0], scenarios.cases)
    values = jnp.zeros(len(rig.controller.places))
    form = eqx.filter_eval_shape(lambda rig, case: rig.residuals(values, case), rig, case)
    if len(form.shape) > 1:
        raise InputError(f"objective: expected one number or a row of residuals; got shape {form.shape}")
    return dataclasses.replace(rig.objective, squares=form.shape != ())


def _points(
    unknowns: Unknowns, starts: int | Sequence[Mapping[str, float]], seed: int
) -> Float[np.ndarray, "starts k"]:
    if isinstance(starts, Sequence):
        return given_starts(unknowns, starts)
    return spread_starts(unknowns, whole(starts, "starts", 1), seed)
