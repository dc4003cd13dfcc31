"""Wiring of a controller of one reading to the command of a whole actuator."""

from __future__ import annotations

import inspect
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators import RIGS, Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.sliding_mode import Reference
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.units import KINDS, is_same_unit

Commands = Float[Array, "*commands"]


def _command() -> Any:
    """A field of an array: a plain number would be part of the program, and a new one compile it anew."""
    return eqx.field(converter=lambda value: jnp.asarray(value, dtype=float))


class Attached(eqx.Module):
    r"""A controller, the reading that it sees, and what its output does: :math:`c = c_0 + d\,u`, limited.

    For :func:`closed_loop`. The controller is one of this package or any with methods ``start()`` → state and
    ``update(state, wanted, measured, step)`` → (state, output u). One that integrates may have a method
    ``without_windup(before, after, output, lowest, highest)`` → state, which is told the limits of u. Class
    variables that it may have: ``reads`` and ``gives``, the SI units of reading and output that its numbers
    are in; ``of_one_number``, true if it follows a value alone, not its rates; ``gains``, the names of what
    :func:`jaxmuscle.tune` moves when nothing else is asked for.

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
            InputError: the rig has no such reading, a :class:`Reference` for a controller of one number, or
                an output that is not one number.
        """
        if isinstance(wanted, Reference) and getattr(self.controller, "of_one_number", False):
            name = type(self.controller).__name__
            raise InputError(f"{name}: expected a reference of one array; got a control.Reference")
        if self.reading not in readings:
            raise InputError(
                f"Attached: expected one of the rig's readings {', '.join(readings)}; got {self.reading!r}"
            )
        after, output = self.controller.update(state, wanted, readings[self.reading], step)
        if jnp.shape(output) != ():
            raise InputError(
                f"{type(self.controller).__name__}: expected an output of one number, shape (); got shape "
                f"{jnp.shape(output)}"
            )
        if hasattr(self.controller, "without_windup"):
            after = self.controller.without_windup(state, after, output, *self._limits)
        return after, jnp.clip(self.rest + self.direction * output, self.lowest, self.highest)

    def on(self, before: AbstractActuator, machine: AbstractActuator) -> Attached:
        """The same on a machine that had the parameters of `before`.

        Commands that no output moves, such as a supply pressure that is one of them, are no part of the
        controller: where they rest at another value on the machine, they go there with it.
        """
        if machine.channel is None:
            return self
        old, new = before.actuation().rest, machine.actuation().rest
        return eqx.tree_at(
            lambda loop: loop.rest, self, jnp.where((self.direction == 0) & (new != old), new, self.rest)
        )

    @property
    def _limits(self) -> tuple[Array, Array]:
        """Outputs u beyond which no command changes any more."""
        return output_limits(Actuation(self.rest, self.direction, self.lowest, self.highest))


def output_limits(acts: Actuation) -> tuple[Array, Array]:
    """Lowest and highest output u beyond which no command changes any more."""
    moves = acts.direction != 0
    divisor = jnp.where(moves, acts.direction, 1.0)
    ends = [_output_at(limit, acts.rest, divisor) for limit in (acts.lowest, acts.highest)]
    # Of a command that the output does not move there is nothing to be said.
    lower = jnp.where(moves, jnp.minimum(*ends), jnp.inf).min()
    upper = jnp.where(moves, jnp.maximum(*ends), -jnp.inf).max()
    return lower, upper


def _output_at(command: Array, rest: Array, divisor: Array) -> Array:
    """Outputs that lead to commands, which may be infinite; without a derivative that is none."""
    some = jnp.isfinite(command)
    there = (jnp.where(some, command, 0.0) - rest) / divisor
    return jnp.where(some, there, command * jnp.sign(divisor))


def feedback_on(actuator: AbstractActuator, controller: Any, **settings: ArrayLike) -> Attached:
    """A controller on the channel that a rig declares (:class:`jaxmuscle.actuators.ControlChannel`).

    Of the rigs of this package:

    * `joint`: angle → ΔU, commands P0 ± ΔU between no pressure and twice the mean one ([T]).
    * `elbow`: angle → gauge pressure, not below none ([W]).
    * `jet-pipe` and `jet-pipe-piston`: force → current of the driver, whose gain and offset are undone
      ([H]); the supply pressure that the latter takes as a command stays the machine's.
    * `isotonic`: position → command of the valve, both ways.

    Args:
        settings: keywords of the rig's `actuation`; of a `joint` `mean_pressure`, P0, gauge [Pa], 2.5 bar
            as in [T] when not given.

    Raises:
        InputError: a rig without a channel; make an :class:`Attached` for it. A controller whose numbers are
            in other units than the channel's: of forces on a joint, of angles on a jet pipe. Settings that
            the rig does not have.
    """
    channel = actuator.declared_channel()
    check_units(actuator, controller)
    known = inspect.signature(actuator.actuation).parameters
    if unknown := [name for name in settings if name not in known]:
        raise InputError(
            f"feedback_on: rig {actuator.rig!r} has no setting {unknown[0]!r}{nearest(unknown[0], known)}"
        )
    return Attached(controller, channel.reading, *actuator.actuation(**settings))


def check_units(actuator: AbstractActuator, controller: Any) -> None:
    """Raise `InputError` for a controller, or a kind of one, with gains in units of another kind of rig."""
    units: Any = getattr(controller, "reads", None), getattr(controller, "gives", None)
    own = _units(type(actuator))
    if None in units or all(map(is_same_unit, own, units)):
        return
    fitting = [
        name
        for name, rig in RIGS.items()
        if rig.channel is not None and all(map(is_same_unit, _units(rig), units))
    ]
    name = (controller if isinstance(controller, type) else type(controller)).__name__
    read, given = (KINDS.get(unit, (unit, ""))[0] for unit in units)
    raise InputError(
        f"{name} turns {read} into {given}: expected rig "
        f"{' or '.join(fitting) or 'none'}; got {actuator.rig!r}, whose channel turns {own[0]} into {own[1]}"
    )


def _units(rig: type[AbstractActuator]) -> tuple[str, str]:
    """Units of the reading that a controller sees, and of its output."""
    channel = rig.declared_channel()
    return rig.column(rig.outputs[channel.reading][0]).unit, channel.unit or ""
