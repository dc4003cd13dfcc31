"""What naming a hidden effect is worth to a controller that is built on the model: its inverse run ahead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from blind_recordings import Blind, drawn
from control_loops import JOINT
from control_plant import Loop, Proved, by_rule, on_plant, proved, together
from measured_rows import worth_of_naming
from published_rows import Row

import jaxmuscle as jm
from jaxmuscle.control import PID, FeedForward, feedback_on, simulated_inverse
from jaxmuscle.tuning.tune import prepared

SHARE, LOOSE = 0.3, 10.0
"""Error that costs one, of that of the gains by rule; how much freer the command of the inverse is."""
STARTS, QUICK = 4, 2e-3
"""Starts of a descent; time constant [s] of the rate on a model, which has no noise, to begin with."""
Sizes = dict[str, float]


def practice(loop: Loop, machine: Any, alone: bool) -> list[jm.tuning.Scenario]:
    """References to tune on; `alone`: on the machine as it is, without noise, else with its payloads."""
    over = {
        name: [float(jm.parameters.get(machine, name)) * by for by in factors]
        for name, factors in loop.factors.items()
    }
    noise = {} if alone else {loop.reading: loop.noise}
    return jm.tuning.grid(
        list(loop.practice), loop.times, {} if alone else over, start=loop.start, noise=noise
    )


def sizes_by_rule(loop: Loop, machine: Any, rule: PID) -> Sizes:
    """Tracking error, effort and rate of the command of the gains by rule, on the model."""
    attached = feedback_on(machine, rule, **loop.settings)
    evaluation = prepared(machine, attached, practice(loop, machine, False), {"tracking": 1.0})
    terms = evaluation.seen(evaluation.unknowns.start, evaluation.rows).terms
    names = "tracking", "effort", "variation"
    return {name: float(np.sqrt(np.mean(np.asarray(terms[name]) ** 2))) for name in names}


def tuned(loop: Loop, machine: Any, begin: Any, sizes: Sizes, alone: bool, **how: Any) -> Any:
    """A controller tuned on a model."""
    attached = feedback_on(machine, begin, **loop.settings)
    found = jm.tune(machine, attached, practice(loop, machine, alone), sizes, worst=4, **how)
    return found.controller.controller


def _inside(machine: Any, rule: PID) -> tuple[PID, list[str] | None]:
    """What runs the model in its inverse, and which of its gains are free.

    Where dry friction holds the load an integral hunts on the model at rest, by 2 degrees, and the command of
    the inverse with it: then there is none.
    """
    if "load_friction" not in machine.effects:
        return rule, None
    kind: Any = PID
    return kind(rule.proportional, 0.0, rule.derivative, QUICK), ["proportional", "derivative", "smoothing"]


def controllers(loop: Loop, machine: Any, rule: PID, known: Sizes) -> dict[str, Any]:
    """On one model: a PID; the model's inverse alone; the inverse ahead of a PID that is tuned beside it."""
    tight = {"tracking": SHARE / 3 * known["tracking"], "variation": LOOSE * known["variation"]}
    sizes = {**known, "tracking": SHARE * known["tracking"]}
    inside, free = _inside(machine, rule)
    inner = tuned(loop, machine, inside, tight, True, starts=STARTS, free=free)
    pid = tuned(loop, machine, rule, sizes, False, starts=STARTS)
    settings: dict[str, Any] = dict(loop.settings)
    inverse = simulated_inverse(machine, loop.step, inner, start=loop.start, **settings)
    kind: Any = FeedForward
    starts = [
        {f"feedback.{gain}": by * float(getattr(own, gain)) for gain in PID.gains}
        for by, own in ((SHARE, pid), (1.0, rule))
    ]
    ahead = kind(inverse, pid)
    both = tuned(loop, machine, ahead, sizes, False, starts=starts, free=list(starts[0]))
    return {"PID": pid, "inverse": kind(inverse), "inverse and PID": both}


def as_it_is(loop: Loop, blind: Blind, controller: Any) -> Proved:
    """Unseen references on the plant as it was recorded, nothing multiplied."""
    return together([on_plant(loop, blind, controller, w, {}, seed) for seed, w in enumerate(loop.unseen)])


def worth_rows(loop: Loop = JOINT) -> Iterator[Row]:
    """Errors on the oracle, by controllers on the model without the effect and on the diagnosed one."""
    unit, size, spent, large = loop.unit
    for seed, effect in loop.hidden.items():
        blind = drawn(seed, loop.rig, 1, False, [effect])
        models = {
            "left out": jm.fit(jm.actuator(blind.recording.card), blind.recording).actuator,
            "named": jm.diagnose(blind.recording).model,
        }
        rule = by_rule(loop, models["left out"])
        known = sizes_by_rule(loop, models["left out"], rule)
        made = {model: controllers(loop, machine, rule, known) for model, machine in models.items()}
        alone: dict[str, Mapping[str, Any]] = {"rule": as_it_is(loop, blind, rule)._asdict()}
        for model, own in made.items():
            for name, each in own.items():
                found = as_it_is(loop, blind, each)
                alone[f"{name}, {model}"] = found._asdict()
                print(f"    {loop.rig}, hidden {effect}, {name}, {model}: {found.tracking / size:.3f} "
                      f"{unit}, largest {found.peak / size:.2f} {unit}, {found.effort / large:.3g} {spent}",
                      flush=True)  # fmt: skip
        last = {"rule": rule, "named": made["named"]["inverse and PID"]}
        yield from worth_of_naming(loop.rig, effect, alone)
        others = proved(loop, blind, last)
        print(f"    other payloads: {others['named'].tracking / size:.3f} {unit} by inverse and PID, "
              f"{others['rule'].tracking / size:.3f} {unit} by rule")  # fmt: skip
