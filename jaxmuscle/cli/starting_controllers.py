"""Controllers that the command line tunes, with gains to begin with, guessed from the ranges of a rig."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.cli.option_values import Unit, split_option, values_of
from jaxmuscle.control import (
    PID,
    FeedForward,
    FuzzyPID,
    ProportionalForce,
    SlidingMode,
    joint_model,
    linear_quadratic,
    model_inverse,
)
from jaxmuscle.control.channel_model import without_dry_friction
from jaxmuscle.control.feedback import check_units, output_limits
from jaxmuscle.control.pid import check_signs
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.tuning.gains import gain_unit

GAIN = "NAME=VALUE[:UNIT]"
SHARE, INTEGRAL, DERIVATIVE = 0.25, 1.0, 0.05
"""A PID that nobody has set begins so: at an error of the references' whole range it gives this share of the
range of its output; integral time and derivative time [s]. A start only, that is not tuned on anything."""
SLOPE, CURVATURE = 7.5, 0.02
"""Of a variable-structure controller [1/s, s]: the middle of what [T] gives."""
LOUD, QUIET = 0.1, 1e-3
"""Of the references' range: the error that costs a linear-quadratic controller as much as that share of the
output; the noise of a sensor of which the card says nothing."""


@dataclasses.dataclass(frozen=True)
class Task:
    """What a controller is for: a machine, the range of what it has to follow, sampling step, sensor noise.

    Attributes:
        range: of the references and zero (SI).
        noise: standard deviation of the reading (SI); 0 where it is not known.
    """

    actuator: AbstractActuator
    range: float
    step: float
    noise: float = 0.0

    @property
    def span(self) -> float:
        """Range of a controller's output within which no command is limited; infinite where none is."""
        lowest, highest = output_limits(self.actuator.actuation())
        return float(highest - lowest)

    def share(self, gain: str, unit: str) -> float:
        """The share of the output that the whole range is answered with.

        Args:
            gain: what it is asked for, in the message, and its unit.

        Raises:
            InputError: nothing says how large outputs or references are.
        """
        begin = f"say where to begin, --gain {gain}=…:{gain_unit(self.actuator, unit)}"
        if not self.range > 0:
            raise InputError(f"the reference does not move, so that no gain can be guessed from it: {begin}")
        if not math.isfinite(self.span):
            raise InputError(
                f"the commands of rig {self.actuator.rig!r} have no limits to guess a gain from: {begin}"
            )
        return SHARE * self.span


Given = dict[str, float]
"""Gains as they were written, in SI."""


def _pid(task: Task, given: Given, prefix: str = "") -> PID:
    kind: Any = PID
    own = {name.removeprefix(prefix): value for name, value in given.items() if name.startswith(prefix)}
    if "proportional" not in own:
        unit = parameters(kind(0.0))["proportional"].unit
        guess = task.share(f"{prefix}proportional", unit) / task.range
        own = {"proportional": guess, "integral": guess / INTEGRAL, "derivative": DERIVATIVE * guess, **own}
    return kind(**own)


def _feedforward(task: Task, given: Given) -> FeedForward:
    kind: Any = FeedForward
    inverse = model_inverse(task.actuator)
    return kind(inverse, _pid(task, given, "feedback."), given.get("share", 1.0))


def _fuzzy(task: Task, given: Given) -> FuzzyPID:
    kind = _fitting(task, FuzzyPID)
    guessed = {"error_range": task.range, "rate_range": task.range / DERIVATIVE}
    if "proportional" not in given:
        share = task.share("proportional", "Pa")
        guessed |= {"proportional": share, "integral": share / INTEGRAL}
    return kind(**{**guessed, **given})


def _sliding_mode(task: Task, given: Given) -> SlidingMode:
    kind, guessed = _fitting(task, SlidingMode), {"slope": SLOPE, "curvature": CURVATURE}
    units = {"per_error": "Pa/rad", "per_rate": "Pa s/rad", "integral_gain": "Pa/(rad s)", "limit": "Pa",
             "integral_limit": "Pa"}  # fmt: skip
    if asked := [name for name in units if name not in given]:
        share = task.share(asked[0], units[asked[0]])
        guessed |= {
            "per_error": share / task.range,
            "per_rate": DERIVATIVE * share / task.range,
            "integral_gain": share / task.range / INTEGRAL,
            "limit": share,
            "integral_limit": share,
        }
    return kind(joint_model(task.actuator), **{**guessed, **given})


def _force(task: Task, given: Given) -> ProportionalForce:
    return _fitting(task, ProportionalForce)(**given)


def _linear_quadratic(task: Task, given: Given) -> Any:
    designed = linear_quadratic(
        without_dry_friction(task.actuator),
        task.step,
        error=LOUD * task.range,
        effort=task.share("integral", "{input}/({output} s)"),
        noise=task.noise or QUIET * task.range,
        integral_time=INTEGRAL,
    )
    return replace(designed, given) if given else designed


def _fitting(task: Task, kind: Any) -> Any:
    """A kind of controller, after a look at whether its numbers are of such a rig.

    Raises:
        InputError: they are not.
    """
    check_units(task.actuator, kind)
    return kind


@dataclasses.dataclass(frozen=True)
class Beginning:
    """A controller of the command line.

    Attributes:
        build: (task, gains in SI) → controller.
        gains: name → unit of what ``--gain`` sets.
        rates: whether it follows rates of the reference too.
        origin: what a report says of gains that nobody gave.
    """

    build: Callable[[Task, Given], Any]
    gains: dict[str, str]
    rates: bool = False
    origin: str = "gains guessed from the ranges of the rig"

    def with_gains(self, task: Task, settings: Sequence[str]) -> Any:
        """The controller with the gains that are given, else with some to begin with.

        Raises:
            InputError: an unknown gain, a value that it may not have, a range that nobody has told, a rig
                that the controller is not for.
        """
        given: Given = {}
        for text in settings:
            name, body = split_option(text, "--gain", GAIN)
            if name not in self.gains:
                raise InputError(f"--gain: unknown gain {name!r}{nearest(name, self.gains)}")
            unit = gain_unit(task.actuator, self.gains[name])
            (value, *more) = values_of(body, f"--gain {text}", GAIN, Unit(unit, unit))
            if more:
                raise InputError(f"--gain {text}: expected {GAIN}, one value")
            given[name] = float(value)
        controller = self.build(task, given)
        check_signs(controller)
        return controller


def _units(kind: type[eqx.Module], prefix: str = "", *without: str) -> dict[str, str]:
    """Name → unit of the plain numbers among the parameters of a kind of controller."""
    fields = {field.name: field for field in dataclasses.fields(kind) if "unit" in field.metadata}
    return {
        prefix + name: field.metadata["unit"]
        for name, field in fields.items()
        if name not in without and "Scalar" in str(field.type)
    }


_GAINS = _units(PID)
CONTROLLERS: dict[str, Beginning] = {
    "pid": Beginning(_pid, _GAINS),
    "feedforward": Beginning(_feedforward, {**_units(FeedForward), **_units(PID, "feedback.")}),
    "lqg": Beginning(
        _linear_quadratic,
        {"integral": "{input}/({output} s)", "ahead": "{input}/{output}"},
        origin="gains designed on the linearised machine",
    ),
    "fuzzy": Beginning(_fuzzy, _units(FuzzyPID)),
    "sliding-mode": Beginning(_sliding_mode, _units(SlidingMode), rates=True),
    "force": Beginning(_force, _units(ProportionalForce), origin="the gain of its source"),
}
"""Controllers by the names of ``--controller``."""


def starting_controller(name: str) -> Beginning:
    """The controller of a name.

    Raises:
        InputError: there is none.
    """
    if name not in CONTROLLERS:
        raise InputError(f"--controller: unknown {name!r}{nearest(name, CONTROLLERS)}")
    return CONTROLLERS[name]
