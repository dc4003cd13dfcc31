"""Independent joint control: a controller of its own for each joint of a robot."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators import Actuation
from jaxmuscle.control.feedback import output_limits
from jaxmuscle.control.sliding_mode import Reference, target_of
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import Scalar
from jaxmuscle.robot import Scara


class IndependentJoints(eqx.Module):
    r"""Controllers of one reading side by side: :math:`c = c_0 + \sum_i d_i u_i`, limited.

    Each sees the angle of its own joint and the reference of it, and knows nothing of the others, whose
    inertia and torques are disturbances to it (Siciliano et al., Robotics, 2009, section 8.3). For
    :func:`closed_loop` and :func:`jaxmuscle.tune`, with a reference of shape (samples, joints), or a
    :class:`Reference` of such arrays. :func:`independent_joints` makes it.

    Attributes:
        joints: the controllers.
        rest: c0, the commands at outputs of zero; direction: d_i, a row for each joint; lowest, highest:
            limits of the commands.
    """

    of_all_readings: ClassVar = True
    reading: ClassVar = "angle"
    reads: ClassVar = "rad"
    gives: ClassVar = "Pa"
    joints: tuple[Any, ...]
    rest: Float[Array, " commands"]
    direction: Float[Array, "joints commands"]
    lowest: Float[Array, " commands"]
    highest: Float[Array, " commands"]

    @property
    def gains(self) -> tuple[str, ...]:
        """What is tuned when nothing else is asked for: the gains of every joint, "joints[0].…"."""
        own = [(i, name) for i, joint in enumerate(self.joints) for name in getattr(joint, "gains", ())]
        return tuple(f"joints[{i}].{name}" for i, name in own)

    def start(self) -> tuple[Any, ...]:
        """The controllers at rest."""
        return tuple(joint.start() for joint in self.joints)

    def update(
        self, state: tuple[Any, ...], wanted: Any, readings: dict[str, Array], step: Scalar
    ) -> tuple[tuple[Any, ...], Float[Array, " commands"]]:
        """The state after a sample of `step` seconds, and the commands until the next.

        Raises:
            InputError: a reference that has not one value for each joint.
        """
        for leaf in jax.tree.leaves(wanted):
            if jnp.shape(leaf) != (len(self.joints),):
                raise InputError(
                    f"IndependentJoints: expected a reference with {len(self.joints)} values at each sample; "
                    f"got shape {jnp.shape(leaf)}"
                )
        after, command = [], self.rest
        for i, (joint, before) in enumerate(zip(self.joints, state, strict=True)):
            own = jax.tree.map(lambda leaf, i=i: leaf[i], wanted)
            if getattr(joint, "of_one_number", False) and isinstance(own, Reference):
                own = target_of(own)
            now, output = joint.update(before, own, readings[self.reading][i], step)
            if hasattr(joint, "without_windup"):
                acts = Actuation(self.rest, self.direction[i], self.lowest, self.highest)
                now = joint.without_windup(before, now, output, *output_limits(acts))
            after.append(now)
            command = command + self.direction[i] * output
        return tuple(after), jnp.clip(command, self.lowest, self.highest)


def independent_joints(
    actuator: Scara, controllers: Sequence[Any], **settings: ArrayLike
) -> IndependentJoints:
    """A controller for each joint of a robot: angle → ΔU of its two muscles, commands P0 ± ΔU ([T]).

    Where the tip is to follow a line, :func:`~jaxmuscle.robot.joints_along` tells what the joints are to do:
    ``control.Reference(*joints_along(robot.arm, line.at(times), elbow))``.

    Args:
        controllers: one for each joint, of an angle.
        settings: of the rig's `joint_actuation`: `mean_pressure`, P0, gauge [Pa].

    Raises:
        InputError: a rig that has no such joints, another number of controllers, one without its two methods
            or in units of another kind of rig, unknown settings.
    """
    if not isinstance(actuator, Scara):
        raise InputError(f"independent_joints: expected rig 'scara'; got {actuator.rig!r}")
    known = inspect.signature(actuator.joint_actuation).parameters
    if unknown := [name for name in settings if name not in known]:
        raise InputError(f"independent_joints: no setting {unknown[0]!r}{nearest(unknown[0], known)}")
    acts, joints = actuator.joint_actuation(**settings), tuple(controllers)
    if len(joints) != len(acts.direction):
        raise InputError(
            f"independent_joints: expected {len(acts.direction)} controllers, one for each joint; got "
            f"{len(joints)}"
        )
    for joint in joints:
        name = type(joint).__name__
        if not all(callable(getattr(joint, method, None)) for method in ("start", "update")):
            raise InputError(
                f"independent_joints: expected controllers with the methods start and update; got {name}"
            )
        if getattr(joint, "reads", None) not in (None, IndependentJoints.reads):
            raise InputError(f"independent_joints: expected controllers of an angle; got {name}")
    return IndependentJoints(joints, *acts)
