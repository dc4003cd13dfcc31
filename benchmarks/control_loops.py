"""Loops on which tuned gains are proved on oracles: a joint that regulators turn, a lift with a supply."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from blind_recordings import SUBSTEPS
from control_plant import Begun, Gains, Loop, Plant, Series
from oracles.isotonic import isotonic  # pyright: ignore[reportMissingImports]
from oracles.joint import joint  # pyright: ignore[reportMissingImports]

from jaxmuscle.analysis import equilibrium_at
from jaxmuscle.control import PID, linear_quadratic
from jaxmuscle.control.channel_model import without_dry_friction

AMBIENT = 101325.0
STEP = 2e-3
TIMES, LONGER = np.arange(0, 3.0, STEP), np.arange(0, 5.0, STEP)
MEAN = 2.2e5
"""Mean gauge pressure of the joint [Pa]."""


def raised(times: Series, amplitude: float, hertz: float) -> Series:
    """A reference that rises from rest and falls back, again and again, smoothly."""
    return 0.5 * amplitude * (1 - np.cos(2 * np.pi * hertz * times))


def risen(times: Series, amplitude: float, seconds: float) -> Series:
    """One that rises so within some seconds, and stays."""
    return 0.5 * amplitude * (1 - np.cos(np.pi * np.minimum(times / seconds, 1.0)))


def about(times: Series, middle: float, swing: float, hertz: float) -> Series:
    """One that rises within a second and swings about where it is then."""
    later = np.maximum(times - 1.0, 0.0)
    return risen(times, middle, 1.0) + swing * np.sin(2 * np.pi * hertz * later)


def _turned(plant: Plant, loop: Loop, answer: Callable[[float], Any]) -> Series:
    """Angles of the joint of the oracle."""
    rest = np.full((len(loop.times), 2), AMBIENT + plant.settings["mean_pressure"])
    *_, angle, _ = joint(
        plant.machine, plant.effects, rest, loop.step, rest[0], 0.0, SUBSTEPS["joint"],
        lambda first, second, angle: answer(angle),
    )  # fmt: skip
    return angle


def _lifted(plant: Plant, loop: Loop, answer: Callable[[float], Any]) -> Series:
    """Positions of the mass of the oracle."""
    _, position, _ = isotonic(
        plant.machine, plant.effects, np.zeros(len(loop.times)), loop.step, AMBIENT, SUBSTEPS["isotonic"],
        lambda pressure, position: answer(position),
    )  # fmt: skip
    return position


EFFORTS = (0.5, 1, 1), (1, 1, 0), (1, 1, 0.5), (1, 3, 0.5), (2, 3, 0.3), (1, 3, 0)
"""Designs at which descents begin: effort [V] that counts as much as a millimetre, time of the integral [s],
share of the rate that goes ahead of what a ramp asks for.
"""


def by_state_feedback(loop: Loop, machine: Any, rule: PID) -> list[Begun]:
    """State feedback with an observer, of the lifted mass without friction, in designs of several efforts;
    and of the mass without any effect, whose observer has fewer states.
    """
    smooth = without_dry_friction(machine)
    bare = dataclasses.replace(smooth, effects={})
    return [_designed(loop, model) for model in ((smooth, bare) if smooth.effects else (bare,))]


def _designed(loop: Loop, smooth: Any) -> Begun:
    """State feedback of a model without dry friction."""
    about = loop.relay[2]
    point = equilibrium_at(smooth, loop.reading, about, start={"pressure": 3 * AMBIENT, loop.reading: about})
    sizes: dict[str, Any] = {"error": 1e-3, "noise": 1e-4, "disturbance": 1.0, "ramps": True, "point": point}
    free, starts = ("feedback", "observer", "integral", "ahead", "ahead_rate"), list[Gains]()
    for effort, integral_time, share in EFFORTS:
        made = linear_quadratic(smooth, loop.step, effort=effort, integral_time=integral_time, **sizes)
        rate = share * float(made.ahead_rate)
        gains = {"integral": float(made.integral), "ahead": float(made.ahead), "ahead_rate": rate}
        for name in free[:2]:
            own = np.asarray(getattr(made, name)).tolist()
            gains |= {f"{name}[{i}]": value for i, value in enumerate(own)}
        starts.append(gains)
    middle = linear_quadratic(smooth, loop.step, effort=1.0, integral_time=1.0, **sizes)
    return Begun(middle, starts, free)


JOINT = Loop(
    rig="joint",
    reading="angle",
    times=TIMES,
    settings={"mean_pressure": MEAN},
    start={"pressure": np.full(2, AMBIENT + MEAN)},
    noise=4e-4,
    sizes={"tracking": float(np.deg2rad(0.25)), "variation": 5e6, "effort": 5e3},
    relay=(1e5, 0.03, 0.0),
    unit=("deg", float(np.deg2rad(1)), "kPa", 1e3),
    practice=(raised(TIMES, 0.3, 0.5), risen(TIMES, -0.25, 0.6)),
    unseen=(raised(TIMES, -0.4, 0.4), risen(TIMES, 0.35, 0.5)),
    swing=0.05,
    hidden={1: "gravity", 41: "load_friction", 106: "load_friction"},
    factors={"inertia": (1.0, 2.0)},
    unseen_factors=tuple({"inertia": by} for by in (1.0, 1.5, 2.0)),
    drawn_factors={"inertia": (1.0, 2.0), "mean_pressure": (0.8, 1.2)},
    run=_turned,
)
"""Regulators have no supply that the model knows: the mean pressure stands for it.

The size of the effort was tuned on the first two plants themselves: with 1e4 Pa what was tuned spent 3 % more
than the rule on the one with friction, without the term 9 %, with a quarter of the rule's tracking error. The
third was drawn after that. One of 100 plants around it, with 0.42 of its inertia, is left swinging; half of
the inertia among those tuned on does not help, and costs the others a quarter of what they gain.
"""
LIFT = Loop(
    rig="isotonic",
    reading="position",
    times=LONGER,
    settings={},
    start={},
    noise=3e-5,
    sizes={"tracking": 3e-4, "variation": 100.0, "effort": 0.15},
    relay=(2.0, 5e-4, 0.02),
    unit=("mm", 1e-3, "V", 1.0),
    practice=(about(LONGER, 0.022, 0.006, 0.5), risen(LONGER, 0.03, 0.8)),
    unseen=(about(LONGER, 0.018, 0.008, 0.4), risen(LONGER, 0.025, 0.6)),
    swing=2e-3,
    hidden={
        1: "chamber_leak",
        2: "load_damping",
        100: "creep",
        104: "rate_limit",
        105: "thread_friction",
        108: "bladder_stiffness",
    },
    factors={"mass": (1.0, 1.6), "supply_pressure": (0.8, 1.1)},
    unseen_factors=(
        {"mass": 1.0, "supply_pressure": 0.7},
        {"mass": 1.3, "supply_pressure": 0.9},
        {"mass": 1.8, "supply_pressure": 1.2},
    ),
    drawn_factors={"mass": (1.0, 1.8), "supply_pressure": (0.75, 1.2)},
    run=_lifted,
    kind="state feedback with an observer",
    begun=by_state_feedback,
)
"""The supply pressure, absolute, is multiplied; its card says 7 bar. The sizes were chosen after a look at
others on the first two plants, with models that lack the effect. The next three were drawn when everything
was chosen: the effects of the first three seeds from 100 on that show by five times the noise. On one of them
descents from designs with the effect's states ended at a higher cost on the model than those without, so both
are tried since; the last plant was drawn after that.
"""
