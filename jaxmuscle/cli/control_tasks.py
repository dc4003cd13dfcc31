"""What a controller of the command line is for: the columns that follow references, ranges, how it is put on
a rig with one control channel, or on each joint of a robot.
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
        joint: of a robot, from 0 on; `None` on a rig with one control channel.
    """

    actuator: AbstractActuator
    range: float
    step: float
    noise: float = 0.0
    joint: int | None = None

    @property
    def actuation(self) -> Actuation:
        """What the output does to the commands."""
        if self.joint is None or not isinstance(self.actuator, Scara):
            return self.actuator.actuation()
        acts = self.actuator.joint_actuation()
        return Actuation(acts.rest, acts.direction[self.joint], acts.lowest, acts.highest)

    @property
    def span(self) -> float:
        """Range of a controller's output within which no command is limited; infinite where none is."""
        lowest, highest = output_limits(self.actuation)
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


def reading_of(actuator: AbstractActuator) -> str:
    """The reading that follows references.

    Raises:
        InputError: the rig has no control channel and is no robot.
    """
    return IndependentJoints.reading if isinstance(actuator, Scara) else actuator.declared_channel().reading


def followed_columns(actuator: AbstractActuator) -> tuple[str, ...]:
    """The columns that references are of: one, or one for each joint of a robot.

    Raises:
        InputError: as for :func:`reading_of`.
    """
    columns = actuator.outputs[reading_of(actuator)]
    return tuple(columns) if isinstance(actuator, Scara) else (columns[0],)


def tasks(actuator: AbstractActuator, card: Card, references: Sequence[Series], step: float) -> list[Task]:
    """What each controller is for, one a column.

    Args:
        references: values of each, of shape (samples,) or (samples, columns) (SI).
        step: sample time [s].
    """
    columns = followed_columns(actuator)
    values = np.concatenate([np.reshape(wanted, (-1, len(columns))) for wanted in references])
    joints = range(len(columns)) if isinstance(actuator, Scara) else [None]
    return [
        Task(actuator, float(np.ptp(np.append(own, 0.0))), step, card.noise.get(name, 0.0), joint)
        for name, own, joint in zip(columns, values.T, joints, strict=True)
    ]


def rest_of(actuator: AbstractActuator) -> Any:
    """Commands at which every controller gives nothing."""
    return (actuator.joint_actuation() if isinstance(actuator, Scara) else actuator.actuation()).rest


def put_together(actuator: AbstractActuator, controllers: Sequence[Any]) -> Any:
    """What :func:`jaxmuscle.tune` takes: the one controller, or those of a robot's joints side by side."""
    return independent_joints(actuator, controllers) if isinstance(actuator, Scara) else controllers[0]


def attached(actuator: AbstractActuator, controller: Any) -> Any:
    """A controller as a closed loop takes it."""
    return controller if isinstance(actuator, Scara) else feedback_on(actuator, controller)
