"""From a controller of one reading to the command of a whole machine."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.actuators.elbow import Elbow
from jaxmuscle.actuators.jetpipe import JetPipeActuator
from jaxmuscle.actuators.joint import SIDES, Joint
from jaxmuscle.control.fuzzy import FuzzyPID
from jaxmuscle.control.pid import IntegralInversePID
from jaxmuscle.control.proportional import ProportionalForce
from jaxmuscle.control.scheduled import ScheduledPID
from jaxmuscle.control.sliding import Reference, SlidingMode
from jaxmuscle.errors import InputError

Commands = Float[Array, "*commands"]
OF_ONE_NUMBER = (FuzzyPID, IntegralInversePID, ProportionalForce, ScheduledPID)
"""Controllers that follow a value alone, not its rates."""


def _command() -> Any:
    """A field of an array: a plain number would be part of the program, and a new one compile it anew."""
    return eqx.field(converter=lambda value: jnp.asarray(value, dtype=float))


class Attached(eqx.Module):
    r"""A controller, the reading that it sees, and what its output does: :math:`c = c_0 + d\,u`, limited.

    For :func:`closed_loop`. The controller is one of this package or any with methods ``start()`` → state and
    ``update(state, wanted, measured, step)`` → (state, output u). One that integrates may have a method
    ``without_windup(before, after, output, lowest, highest)`` → state, which is told the limits of u.

    Attributes:
        reading: name of the reading, an output of the rig such as "angle".
        rest: c0, the command at an output of zero, one entry a command.
        direction: d, command per output.
        lowest, highest: limits of the command.
    """

    controller: Any
    reading: str = eqx.field(static=True)
    rest: Commands = _command()
    direction: Commands = _command()
    lowest: Commands = _command()
    highest: Commands = _command()

    def start(self, *at: ArrayLike) -> Any:
        """State of the controller at rest; `at` is what its own `start` takes."""
        return self.controller.start(*at)

    def update(
        self, state: Any, wanted: Any, readings: dict[str, Array], step: Float[Array, ""]
    ) -> tuple[Any, Commands]:
        """The state after a sample of `step` seconds, and the command until the next.

        Raises:
            InputError: the rig has no such reading, or a :class:`Reference` for a controller of one number.
        """
        if isinstance(wanted, Reference) and isinstance(self.controller, OF_ONE_NUMBER):
            name = type(self.controller).__name__
            raise InputError(f"{name}: expected a reference of one array; got a control.Reference")
        if self.reading not in readings:
            raise InputError(
                f"Attached: expected one of the rig's readings {', '.join(readings)}; got {self.reading!r}"
            )
        after, output = self.controller.update(state, wanted, readings[self.reading], step)
        if hasattr(self.controller, "without_windup"):
            after = self.controller.without_windup(state, after, output, *self._limits)
        return after, jnp.clip(self.rest + self.direction * output, self.lowest, self.highest)

    @property
    def _limits(self) -> tuple[Array, Array]:
        """Outputs u beyond which no command changes any more."""
        acts = self.direction != 0
        divisor = jnp.where(acts, self.direction, 1.0)
        ends = [self._output_at(limit, divisor) for limit in (self.lowest, self.highest)]
        # Of a command that the output does not move there is nothing to be said.
        lower = jnp.where(acts, jnp.minimum(*ends), jnp.inf).min()
        upper = jnp.where(acts, jnp.maximum(*ends), -jnp.inf).max()
        return lower, upper

    def _output_at(self, command: Array, divisor: Array) -> Array:
        """Outputs that lead to commands, which may be infinite; without a derivative that is none."""
        some = jnp.isfinite(command)
        there = (jnp.where(some, command, 0.0) - self.rest) / divisor
        return jnp.where(some, there, command * jnp.sign(divisor))


def feedback_on(actuator: AbstractActuator, controller: Any, *, mean_pressure: ArrayLike = 2.5e5) -> Attached:
    """A controller on a rig of this package.

    * `joint`: angle → ΔU, commands P0 ± ΔU between no pressure and twice the mean one ([T]).
    * `elbow`: angle → gauge pressure, not below none ([W]).
    * `jet-pipe`: force → current of the driver, whose gain and offset are undone ([H]).

    Args:
        mean_pressure: P0 of a joint, gauge [Pa]; 2.5 bar in [T].

    Raises:
        InputError: another rig; make a :class:`Attached` for it. A controller of forces on a joint, or of
            angles on a jet pipe.
    """
    _check_kind(actuator, controller)
    if isinstance(actuator, Joint):
        ambient, mean, side = actuator.ambient_pressure, jnp.asarray(mean_pressure, dtype=float), jnp.ones(2)
        rest = (ambient + mean) * side
        return Attached(
            controller, "angle", rest, jnp.asarray(SIDES), ambient * side, (ambient + 2 * mean) * side
        )
    if isinstance(actuator, Elbow):
        ambient = actuator.ambient_pressure
        return Attached(controller, "angle", ambient, jnp.ones(()), ambient, jnp.asarray(jnp.inf))
    if isinstance(actuator, JetPipeActuator):
        driver, limit = actuator.driver, jnp.asarray(jnp.inf)
        return Attached(controller, "force", -driver.offset / driver.gain, 1 / driver.gain, -limit, limit)
    raise InputError(
        f"expected a rig joint, elbow or jet-pipe; got {actuator.rig!r}; make a control.Attached for it"
    )


def _check_kind(actuator: AbstractActuator, controller: Any) -> None:
    """Raise `InputError` for a controller whose gains are in the units of another kind of rig."""
    name, forces = type(controller).__name__, isinstance(actuator, JetPipeActuator)
    if isinstance(controller, ProportionalForce) and not forces:
        raise InputError(f"{name} turns a force into a current: expected rig jet-pipe; got {actuator.rig!r}")
    if isinstance(controller, FuzzyPID | SlidingMode) and forces:
        raise InputError(
            f"{name} turns an angle into a pressure: expected rig joint or elbow; got {actuator.rig!r}"
        )
