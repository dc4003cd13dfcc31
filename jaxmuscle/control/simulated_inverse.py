"""Inverse of any machine's model by simulation: what a controller gives that runs the model itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.feedback import check_units, output_limits
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar
from jaxmuscle.simulation.simulation_state import SimulationState
from jaxmuscle.simulation.stepper import Stepper, stepper


class Following(eqx.Module):
    """State of a simulated inverse: those of the model, and of the controller that runs it."""

    machine: SimulationState
    controller: Any


class SimulatedInverse(eqx.Module):
    r"""The output that leads a model along a reference, found by a controller on the model.

    At every sample the controller sees the model's reading, which has neither noise nor anything that the
    model lacks, and the model goes on under the output that it gives. Its gains may therefore be larger than
    on the machine: the larger they are, the more its output is the inverse of the model, as in the integral
    inverse of hysteresis (:class:`~jaxmuscle.hysteresis.IntegralInverse`), here with dry friction, valve,
    effects and the limits of the command. A machine that integrates its command, of which there is no table
    at rest (:func:`model_inverse`), has such an inverse too. Where dry friction holds the model, an integral
    in that controller hunts: under a reference at rest the model sticks and slips for ever, and the output
    that goes ahead shakes the machine. Leave it out there (`integral` 0); the feedback beside the inverse has
    the one that is needed. For :class:`FeedForward`;
    :func:`simulated_inverse` makes it.

    :func:`jaxmuscle.tune` moves the gains of the controller, "inverse.controller.proportional" of a
    feed-forward.
    """

    model: Stepper
    acts: Actuation
    initial: SimulationState
    controller: Any

    @property
    def gains(self) -> tuple[str, ...]:
        """What is tuned when nothing else is asked for."""
        return tuple(f"controller.{name}" for name in getattr(self.controller, "gains", ()))

    def start(self) -> Following:
        """The model where it begins."""
        return Following(self.initial, self.controller.start())

    def update(
        self, state: Following, target: Scalar | float, step: float | Scalar
    ) -> tuple[Following, Scalar]:
        """The state after a sample, and the output u that leads the model to the target."""
        reading = self.model.actuator.declared_channel().reading
        shown = self.model.readings(state.machine)[reading]
        after, output = self.controller.update(state.controller, target, shown, step)
        lowest, highest = output_limits(self.acts)
        if hasattr(self.controller, "without_windup"):
            after = self.controller.without_windup(state.controller, after, output, lowest, highest)
        output = jnp.clip(output, lowest, highest)
        machine, _ = self.model.step(state.machine, self.acts.rest + self.acts.direction * output)
        return Following(machine, after), output


def simulated_inverse(
    actuator: AbstractActuator,
    step: float,
    controller: Any,
    *,
    start: Mapping[str, ArrayLike] | None = None,
    substeps: int | None = None,
    **settings: ArrayLike,
) -> SimulatedInverse:
    """The inverse of a rig's channel by a controller of one reading that runs the rig's model.

    Args:
        actuator: the model.
        step: sampling step of the loop [s], which the loop has to have too.
        controller: such as a :class:`PID`, that leads the model along a reference.
        start: measured states with which the model begins; at rest when `None`.
        substeps: of the model, as for :func:`jaxmuscle.simulate`.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, a controller without its two methods or in units of another kind
            of rig, a step that is too long for the rig.
    """
    actuator.declared_channel()
    if not all(callable(getattr(controller, method, None)) for method in ("start", "update")):
        raise InputError(
            "simulated_inverse: expected a controller with the methods start and update; got "
            f"{type(controller).__name__}"
        )
    check_units(actuator, controller)
    model = stepper(actuator, step, substeps=substeps)
    return SimulatedInverse(model, actuator.actuation(**settings), model.initial(start), controller)
