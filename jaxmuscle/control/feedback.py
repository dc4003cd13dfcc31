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
from jaxmuscle.errors import InputError

Commands = Float[Array, "*commands"]


class Attached(eqx.Module):
    r"""A controller, the reading that it sees, and what its output does: :math:`c = c_0 + d\,u`, limited.

    For :func:`closed_loop`. The controller is one of this package or any with methods ``start()`` → state and
    ``update(state, wanted, measured, step)`` → (state, output u).

    Attributes:
        reading: name of the reading, an output of the rig such as "angle".
        rest: c0, the command at an output of zero, one entry a command.
        direction: d, command per output.
        lowest, highest: limits of the command.
    """

    controller: Any
    reading: str = eqx.field(static=True)
    rest: Commands
    direction: Commands
    lowest: Commands
    highest: Commands

    def start(self, *at: ArrayLike) -> Any:
        """State of the controller at rest; `at` is what its own `start` takes."""
        return self.controller.start(*at)

    def update(
        self, state: Any, wanted: Any, readings: dict[str, Array], step: Float[Array, ""]
    ) -> tuple[Any, Commands]:
        """The state after a sample of `step` seconds, and the command until the next."""
        state, output = self.controller.update(state, wanted, readings[self.reading], step)
        return state, jnp.clip(self.rest + self.direction * output, self.lowest, self.highest)


def feedback_on(actuator: AbstractActuator, controller: Any, *, mean_pressure: ArrayLike = 2.5e5) -> Attached:
    """A controller on a rig of this package.

    * `joint`: angle → ΔU, commands P0 ± ΔU between no pressure and twice the mean one ([T]).
    * `elbow`: angle → gauge pressure, not below none ([W]).
    * `jet-pipe`: force → current of the driver, whose gain and offset are undone ([H]).

    Args:
        mean_pressure: P0 of a joint, gauge [Pa]; 2.5 bar in [T].

    Raises:
        InputError: another rig; make a :class:`Attached` for it.
    """
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
