"""Commands as functions of time, whose parameters can be swept.

A command is a small module: parameters in SI, and a call that gives the command at one instant. Any
`equinox.Module` with a ``__call__(time)`` will do; :class:`Function` makes one of a plain function.
Parameters are scalars for a rig with one command, and may be arrays over the muscles for one with several.
"""

from __future__ import annotations

import abc
import inspect
from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Level = Float[Array, "*muscles"]
Given = Any
"""A number, or one for each muscle; a field keeps it as an array."""


class AbstractCommand(eqx.Module):
    """A command over time."""

    @abc.abstractmethod
    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s], in the unit of the rig's command."""


class Sine(AbstractCommand):
    """``mean + amplitude · sin(2π · frequency · time + phase)``."""

    amplitude: Given = parameter("{command}", "amplitude of the command", default=1.0)
    frequency: Given = parameter("Hz", "frequency of the command", default=1.0, positive=True)
    mean: Given = parameter("{command}", "mean of the command", default=0.0)
    phase: Given = parameter("rad", "phase of the command at time 0", default=0.0)

    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s]."""
        return self.mean + self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * time + self.phase)


class Step(AbstractCommand):
    """`before` until `begin`, then `level`."""

    level: Given = parameter("{command}", "command after the step", default=1.0)
    begin: Given = parameter("s", "instant of the step", default=0.0)
    before: Given = parameter("{command}", "command before the step", default=0.0)

    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s]."""
        return jnp.where(time >= self.begin, self.level, self.before)


class Pulse(AbstractCommand):
    """`level` from `begin` for `length`, `rest` before and after."""

    level: Given = parameter("{command}", "command during the pulse", default=1.0)
    length: Given = parameter("s", "length of the pulse", default=0.1, positive=True)
    begin: Given = parameter("s", "instant at which the pulse begins", default=0.0)
    rest: Given = parameter("{command}", "command before and after the pulse", default=0.0)

    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s]."""
        inside = (time >= self.begin) & (time < self.begin + self.length)
        return jnp.where(inside, self.level, self.rest)


class Ramp(AbstractCommand):
    """From `before` to `level` in a straight line that begins at `begin` and takes `length`."""

    level: Given = parameter("{command}", "command after the ramp", default=1.0)
    length: Given = parameter("s", "duration of the ramp", default=1.0, positive=True)
    begin: Given = parameter("s", "instant at which the ramp begins", default=0.0)
    before: Given = parameter("{command}", "command before the ramp", default=0.0)

    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s]."""
        share = jnp.clip((time - self.begin) / self.length, 0.0, 1.0)
        return self.before + share * (self.level - self.before)


class Function(AbstractCommand):
    """A function ``f(time, **parameters)`` of JAX operations, with the values of its parameters."""

    function: Callable[..., Any] = eqx.field(static=True)
    parameters: dict[str, Array]

    @property
    def frequency(self) -> Array | None:
        """Its parameter of this name, for reductions at the command's frequency."""
        return self.parameters.get("frequency")

    def __call__(self, time: Scalar) -> Level:
        """The command at `time` [s]."""
        return jnp.asarray(self.function(time, **self.parameters), dtype=float)


COMMANDS: dict[str, type[AbstractCommand]] = {"sine": Sine, "step": Step, "pulse": Pulse, "ramp": Ramp}
"""The commands that the command line offers."""


def command_of(function: Callable[..., Any], swept: Iterable[str]) -> Function:
    """A command from ``f(time, **parameters)``: defaults from its signature, zero for those that are swept.

    Raises:
        InputError: a parameter without a default that is not swept either.
    """
    takes = list(inspect.signature(function).parameters.values())
    values, swept = {}, set(swept)
    for entry in takes[1:]:
        if entry.kind is entry.VAR_KEYWORD:
            values |= dict.fromkeys(swept - set(values), 0.0)
        elif entry.default is not entry.empty:
            values[entry.name] = entry.default
        elif entry.name in swept:
            values[entry.name] = 0.0
        else:
            raise InputError(
                f"command: its parameter {entry.name!r} has no value; give it a default "
                f"or sweep it with over={{'command.{entry.name}': …}}"
            )
    return Function(function, {name: jnp.asarray(value, dtype=float) for name, value in values.items()})
