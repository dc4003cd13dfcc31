"""Controllers that the command line tunes, with gains to begin with, guessed from the ranges of a rig."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx

from jaxmuscle.cli.control_tasks import Task
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
from jaxmuscle.control.pid import check_signs
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import parameters, replace

GAIN = "NAME=VALUE[:UNIT]"
INTEGRAL, DERIVATIVE = 1.0, 0.05
"""Integral time and derivative time [s] of a PID that nobody has set; a start only, as its share of the
output is (:data:`jaxmuscle.cli.control_tasks.SHARE`)."""
SLOPE, CURVATURE = 7.5, 0.02
"""Of a variable-structure controller [1/s, s]: the middle of what [T] gives."""
LOUD, QUIET = 0.1, 1e-3
"""Of the references' range: the error that costs a linear-quadratic controller as much as that share of the
output; the noise of a sensor of which the card says nothing."""


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
    task.check_kind(kind)
    return kind


@dataclasses.dataclass(frozen=True)
class Beginning:
    """A controller of the command line.

    Attributes:
        build: (task, gains in SI) → controller.
        gains: name → unit of what ``--gain`` sets.
        rates: whether it follows rates of the reference too.
        origin: what a report says of gains that nobody gave.
        of_joints: whether it may be put on each joint of a robot.
    """

    build: Callable[[Task, Given], Any]
    gains: dict[str, str]
    rates: bool = False
    origin: str = "gains guessed from the ranges of the rig"
    of_joints: bool = False

    def for_all(self, tasks: Sequence[Task], settings: Sequence[str]) -> list[Any]:
        """A controller for each task; of a robot, "joints[1].NAME=…" sets one joint's, "NAME=…" all others'.

        Raises:
            InputError: as for :meth:`with_gains`, or a controller that is none of a robot's joint.
        """
        if all(task.joint is None for task in tasks):
            return [self.with_gains(task, settings) for task in tasks]
        if not self.of_joints:
            fitting = [name for name, each in CONTROLLERS.items() if each.of_joints]
            rig = tasks[0].actuator.rig
            raise InputError(f"--controller: expected {' or '.join(fitting)} for each joint of rig {rig!r}")
        places = [f"joints[{number}]." for number in range(len(tasks))]
        if unknown := [s for s in settings if s.startswith("joints[") and not s.startswith(tuple(places))]:
            raise InputError(f"--gain {unknown[0]}: expected {' or '.join(f'{p}NAME=…' for p in places)}")
        own = [_of_joint(settings, place) for place in places]
        return [self.with_gains(task, each) for task, each in zip(tasks, own, strict=True)]

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
            unit = task.unit(self.gains[name])
            (value, *more) = values_of(body, f"--gain {text}", GAIN, Unit(unit, unit))
            if more:
                raise InputError(f"--gain {text}: expected {GAIN}, one value")
            given[name] = float(value)
        controller = self.build(task, given)
        check_signs(controller)
        return controller


def _of_joint(settings: Sequence[str], place: str) -> list[str]:
    """Settings of one joint, without its name, and those of all that it has not of its own."""
    own = [text.removeprefix(place) for text in settings if text.startswith(place)]
    names = {text.partition("=")[0] for text in own}
    common = [text for text in settings if not text.startswith("joints[")]
    return own + [text for text in common if text.partition("=")[0] not in names]


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
    "pid": Beginning(_pid, _GAINS, of_joints=True),
    "feedforward": Beginning(_feedforward, {**_units(FeedForward), **_units(PID, "feedback.")}),
    "lqg": Beginning(
        _linear_quadratic,
        {"integral": "{input}/({output} s)", "ahead": "{input}/{output}"},
        origin="gains designed on the linearised machine",
    ),
    "fuzzy": Beginning(_fuzzy, _units(FuzzyPID), of_joints=True),
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
