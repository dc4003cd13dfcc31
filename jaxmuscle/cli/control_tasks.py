"""What controllers of the command line are put on, a rig's control channel or each joint of a robot, and what
each of them is for.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control import IndependentJoints, feedback_on, independent_joints
from jaxmuscle.control.feedback import check_units, output_limits
from jaxmuscle.errors import InputError
from jaxmuscle.recordings.card import Card
from jaxmuscle.robot import Scara
from jaxmuscle.tuning.gains import gain_unit
from jaxmuscle.units import Series

SHARE = 0.25
"""At an error of the references' whole range a controller that nobody has set gives this share of the range
of its output. A start only, that is not tuned on anything."""


@dataclasses.dataclass(frozen=True)
class Task:
    """What one controller is for: a machine, the range of what it has to follow, sampling step, sensor noise.

    Attributes:
        range: of the references and zero (SI).
        noise: standard deviation of the reading (SI); 0 where it is not known.
        joint: what the output does to the commands where it is that of a robot's joint; `None` on a rig with
            one control channel.
    """

    actuator: AbstractActuator
    range: float
    step: float
    noise: float = 0.0
    joint: Actuation | None = None

    @property
    def span(self) -> float:
        """Range of a controller's output within which no command is limited; infinite where none is."""
        lowest, highest = output_limits(self.actuator.actuation() if self.joint is None else self.joint)
        return float(highest - lowest)

    def unit(self, unit: str) -> str:
        """The unit of a gain, in which {input} and {output} are those of the rig."""
        return gain_unit(self.actuator, unit, IndependentJoints)

    def share(self, gain: str, unit: str) -> float:
        """The share of the output that the whole range is answered with.

        Args:
            gain: what it is asked for, in the message, and its unit.

        Raises:
            InputError: nothing says how large outputs or references are.
        """
        begin = f"say where to begin, --gain {gain}=…:{self.unit(unit)}"
        if not self.range > 0:
            raise InputError(f"the reference does not move, so that no gain can be guessed from it: {begin}")
        if not math.isfinite(self.span):
            raise InputError(
                f"the commands of rig {self.actuator.rig!r} have no limits to guess a gain from: {begin}"
            )
        return SHARE * self.span

    def check_kind(self, kind: Any) -> None:
        """Raise `InputError` for a kind of controller whose numbers are not of such a rig."""
        if self.joint is None:
            check_units(self.actuator, kind)


@dataclasses.dataclass(frozen=True)
class ControlledColumns:
    """What references are of, and how controllers are put on it.

    Attributes:
        reading: that follows references; columns: those of it, one for each controller.
        joints: what the output of each joint's controller does to the commands of a robot; none on a rig with
            one control channel.
        rest: commands at which every controller gives nothing.
    """

    actuator: AbstractActuator
    reading: str
    columns: tuple[str, ...]
    joints: tuple[Actuation, ...]
    rest: Any

    def tasks(self, card: Card, references: Sequence[Series], step: float) -> list[Task]:
        """What each controller is for.

        Args:
            references: values of each, of shape (samples,) or (samples, columns) (SI).
            step: sample time [s].
        """
        values = np.concatenate([np.reshape(wanted, (-1, len(self.columns))) for wanted in references])
        return [
            Task(self.actuator, float(np.ptp(np.append(own, 0.0))), step, card.noise.get(name, 0.0), joint)
            for name, own, joint in zip(self.columns, values.T, self.joints or (None,), strict=True)
        ]

    def together(self, controllers: Sequence[Any]) -> Any:
        """What :func:`jaxmuscle.tune` takes: the one controller, or those of the joints side by side."""
        if isinstance(self.actuator, Scara):
            return independent_joints(self.actuator, controllers)
        return controllers[0]

    def attached(self, controller: Any) -> Any:
        """Such a controller as a closed loop takes it."""
        return controller if self.joints else feedback_on(self.actuator, controller)


def controlled_columns(actuator: AbstractActuator) -> ControlledColumns:
    """What controllers are put on.

    Raises:
        InputError: the rig has no control channel and is no robot.
    """
    if isinstance(actuator, Scara):
        acts, reading = actuator.joint_actuation(), IndependentJoints.reading
        joints = tuple(Actuation(acts.rest, own, acts.lowest, acts.highest) for own in acts.direction)
        return ControlledColumns(actuator, reading, tuple(actuator.outputs[reading]), joints, acts.rest)
    reading = actuator.declared_channel().reading
    return ControlledColumns(
        actuator, reading, (actuator.outputs[reading][0],), (), actuator.actuation().rest
    )
