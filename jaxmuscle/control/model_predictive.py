"""Nonlinear model predictive control of one reading, on the machine's own model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.feedback import output_limits
from jaxmuscle.control.pid import check_signs
from jaxmuscle.control.sliding_mode import Reference
from jaxmuscle.errors import InputError
from jaxmuscle.optimization.gauss_newton import gauss_newton_step
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.simulation.simulation_state import SimulationState
from jaxmuscle.simulation.stepper import Stepper, stepper

Plan = Float[Array, " blocks"]


class Predicting(eqx.Module):
    """State of the controller: that of its model, the plan that it follows, the output of the last sample."""

    machine: SimulationState
    plan: Plan
    output: Scalar


class ModelPredictive(eqx.Module):
    r"""Model predictive controller: the first of the outputs that make least, over a horizon,

    .. math:: \frac1h \sum_k \left(\frac{y_k + d - r}{e}\right)^2
              + \sum_j \left(\frac{u_j - u_{j-1}}{f}\right)^2

    each u_j held for h samples (Rawlings, Mayne and Diehl, Model Predictive Control, 2nd ed. 2017). y_k is
    what the model shows on its way from its own state, which runs along under the commands that are given,
    and d = y - y_model what it shows wrongly now: no error is left at rest on a machine that the model is
    not. Machines that come to rest by themselves only: a model that integrates runs away from its machine.
    The plan of the sample before, one sample on, is where a few Gauss-Newton steps begin (real-time
    iteration: Diehl, Bock and Schlöder, SIAM J. Control Optim. 43, 2005); after each, outputs are cut to
    their limits, beside which the others are not optimised anew. :func:`model_predictive` makes it.

    The reference may look ahead: one number, or one for each sample of the horizon.
    """

    gains: ClassVar = ("move",)
    model: Stepper
    acts: Actuation
    initial: SimulationState
    error: Scalar = parameter("{output}", "error e that costs one", positive=True)
    move: Scalar = parameter("{input}", "change f of the output that costs one", positive=True)
    blocks: int = eqx.field(static=True, default=10)
    hold: int = eqx.field(static=True, default=1)
    iterations: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        """Raise `InputError` for sizes that are not above zero, or numbers below one."""
        check_signs(self)
        for name in ("blocks", "hold", "iterations"):
            number = getattr(self, name)
            if isinstance(number, bool) or not isinstance(number, int) or number < 1:
                raise InputError(
                    f"ModelPredictive: {name}: expected a whole number from 1 on; got {number!r}"
                )

    def start(self) -> Predicting:
        """The model where it begins, and a plan to do nothing."""
        return Predicting(self.initial, jnp.zeros(self.blocks), jnp.zeros(()))

    def update(
        self, state: Predicting, wanted: Any, measured: Scalar, step: float | Scalar
    ) -> tuple[Predicting, Scalar]:
        """The state after a sample, and the output u until the next.

        Raises:
            InputError: a reference that is neither one number nor one for each sample of the horizon.
        """
        samples = self.blocks * self.hold
        if isinstance(wanted, Reference):
            raise InputError("ModelPredictive: expected a reference of numbers; got a control.Reference")
        if jnp.shape(wanted) not in ((), (samples,)):
            raise InputError(
                f"ModelPredictive: expected a reference of one number, or {samples} at each sample, one for "
                f"each of the horizon; got shape {jnp.shape(wanted)}"
            )
        wrong = measured - self._reading(self.model.readings(state.machine))
        lowest, highest = output_limits(self.acts)

        def residuals(plan: Plan) -> Array:
            shown = self._predicted(state.machine, jnp.repeat(plan, self.hold))
            errors = (shown + wrong - wanted) / (self.error * jnp.sqrt(self.hold))
            return jnp.concatenate([errors, jnp.diff(plan, prepend=state.output) / self.move])

        plan = state.plan
        for _ in range(self.iterations):
            plan = jnp.clip(gauss_newton_step(residuals, plan), lowest, highest)
        machine, _ = self.model.step(state.machine, self._command(plan[0]))
        return Predicting(machine, self._later(plan), plan[0]), plan[0]

    def _command(self, output: Scalar) -> Array:
        acts = self.acts
        return jnp.clip(acts.rest + acts.direction * output, acts.lowest, acts.highest)

    def _reading(self, readings: dict[str, Array]) -> Array:
        return readings[self.model.actuator.declared_channel().reading]

    def _predicted(self, machine: SimulationState, outputs: Array) -> Array:
        """Readings after each of the outputs, held for a sample."""

        def onward(state: SimulationState, output: Scalar) -> tuple[SimulationState, Array]:
            # Not limited: a plan keeps to the limits, and beyond them there would be no slopes.
            after, readings = self.model.step(state, self.acts.rest + self.acts.direction * output)
            return after, self._reading(readings)

        return jax.lax.scan(onward, machine, outputs)[1]

    def _later(self, plan: Plan) -> Plan:
        """The plan a sample later: its last output goes on."""
        places = jnp.arange(self.blocks) * self.hold + 1
        return jnp.append(jnp.repeat(plan, self.hold), plan[-1])[places]


def model_predictive(
    actuator: AbstractActuator,
    step: float,
    *,
    error: float,
    move: float,
    blocks: int = 10,
    hold: int = 1,
    iterations: int = 1,
    start: Mapping[str, ArrayLike] | None = None,
    **settings: ArrayLike,
) -> ModelPredictive:
    """A model predictive controller of a rig's channel.

    Args:
        actuator: the model; dry friction that holds it has no slopes: give one without it.
        step: sampling step of the loop [s], which the loop has to have too.
        error, move: sizes of an error and of a change of the output, from block to block, that cost alike.
        blocks, hold: outputs that are free, and samples for which each is held.
        iterations: Gauss-Newton steps at a sample.
        start: measured states with which the model begins; at rest when `None`.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, a size or a number that is not above zero, a step that is too
            long for the rig.
    """
    actuator.declared_channel()
    model, made = stepper(actuator, step), ModelPredictive
    acts = actuator.actuation(**settings)
    initial = model.initial(start)
    numbers: Any = {"error": error, "move": move}
    return made(model, acts, initial, **numbers, blocks=blocks, hold=hold, iterations=iterations)
