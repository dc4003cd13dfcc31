"""Packed state: an actuator under a constant command as a function of one vector."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.sensing import sensed
from jaxmuscle.effects.base import States
from jaxmuscle.effects.slip import STICKING_TIME
from jaxmuscle.errors import InputError
from jaxmuscle.signals import Past
from jaxmuscle.simulation import Track, start_at_rest
from jaxmuscle.simulation.sensor_errors import shown_readings

Packed = Float[Array, " states"]
Readings = Float[Array, " readings"]


@dataclasses.dataclass(frozen=True)
class Packing:
    """How states lie in one vector; equal for equal machines, so that what is compiled for one serves all."""

    tree: Any
    shapes: tuple[tuple[int, ...], ...]

    def __call__(self, packed: Packed) -> State:
        """The states by their names."""
        ends = np.cumsum([int(np.prod(shape)) for shape in self.shapes])[:-1]
        parts = jnp.split(packed, ends)
        return jax.tree.unflatten(
            self.tree, [part.reshape(s) for part, s in zip(parts, self.shapes, strict=True)]
        )


class Situation(eqx.Module):
    """Packed states of a machine, of which some may be held, and the memories of its effects.

    Attributes:
        start: packed states that are not held.
        held: states that keep their value.
        memory: memories of effects, which do not change.
    """

    start: Packed
    held: State
    memory: States
    unpack: Packing = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def rates(self, actuator: AbstractActuator, packed: Packed, command: Array) -> Packed:
        r"""Packed time derivatives under a constant command, :math:`f(Πx) + (Πx - x)/τ`.

        Π: what stops leave of a state (`constrained`); τ: :data:`STICKING_TIME`. Within the stops Πx = x. At
        a stop, where f alone leaves the position open, x goes back to it with rate 1/τ, so that a machine
        that lies against a stop has one state of rest there.
        """
        free = self.unpack(packed)
        state = {**free, **self.held}
        stopped = actuator.constrained(state)
        rates = actuator.vector_field(stopped, steady(actuator, command, self.memory))
        back = jax.tree.map(lambda inside, x: (inside - x) / STICKING_TIME, stopped, state)
        return ravel_pytree({name: jax.tree.map(jnp.add, rates[name], back[name]) for name in free})[0]

    def readings(self, actuator: AbstractActuator, packed: Packed, command: Array) -> Readings:
        """All readings as one vector, in the order of the rig's outputs, as sensors show them at first."""
        state = {**self.unpack(packed), **self.held}
        signals = actuator.signals(state, steady(actuator, command, self.memory))
        readings = sensed(actuator, signals, {**state.get("effects", {}), **self.memory})
        begin = Track(jnp.asarray(1.0), command[None], {})
        series = {name: values[None] for name, values in readings.items()}
        shown = shown_readings(actuator, series, begin, 0)
        return jnp.concatenate([jnp.ravel(shown[name]) for name in actuator.outputs])

    def output(self, actuator: AbstractActuator, column: str) -> int:
        """Place of a column ("force", "pressure_2") in the vector of readings."""
        columns = [name for names in actuator.outputs.values() for name in names]
        if column not in columns:
            raise InputError(f"expected an output of rig {actuator.rig!r}, one of {columns}; got {column!r}")
        return columns.index(column)


def situation(
    actuator: AbstractActuator, command: ArrayLike, start: Mapping[str, ArrayLike], hold: tuple[str, ...]
) -> Situation:
    """The machine at rest under `command`, its measured states as `start` says.

    Raises:
        InputError: a rig without a command; a state to start from or to hold that the rig does not have.
    """
    if not actuator.commands:
        raise InputError(f"rig {actuator.rig!r} has no command, and so no operating point of its own")
    measured = _measured(actuator, start)
    steady_command = jnp.asarray(command, dtype=float)
    track = Track(jnp.asarray(1.0), steady_command[None], measured, before=steady_command)
    begin = start_at_rest(actuator, track)
    if unknown := set(hold) - set(begin.state):
        raise InputError(f"hold: expected states of {sorted(begin.state)}; got {sorted(unknown)}")
    free = {name: value for name, value in begin.state.items() if name not in hold}
    kept = {name: value for name, value in begin.state.items() if name in hold}
    leaves, tree = jax.tree.flatten(free)
    packing = Packing(tree, tuple(jnp.shape(leaf) for leaf in leaves))
    return Situation(ravel_pytree(free)[0], kept, begin.memory, packing, _names(free))


def steady(actuator: AbstractActuator, command: Array, memory: States) -> Held:
    """What stays as it is under a command that has always been the same."""
    past = Past(jnp.stack([command]), jnp.asarray(0), jnp.asarray(1.0), command)
    return Held(command, past, memory, time=jnp.asarray(0.0))


def _measured(actuator: AbstractActuator, start: Mapping[str, ArrayLike]) -> dict[str, Array]:
    names = (*actuator.measured, *actuator.derivatives)
    if unknown := set(start) - set(names):
        raise InputError(f"start: expected some of {sorted(names)}; got {sorted(unknown)}")
    found = {}
    for name in names:
        rest = actuator.at_rest(name)
        found[name] = jnp.broadcast_to(jnp.asarray(start.get(name, rest), dtype=float), rest.shape)[None]
    return found


def _names(state: State) -> tuple[str, ...]:
    """A name for every entry of the packed state."""
    names = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(state)[0]:
        name = ".".join(str(getattr(key, "key", key)) for key in path)
        size = int(np.size(leaf))
        names += [name] if jnp.ndim(leaf) == 0 else [f"{name}_{i + 1}" for i in range(size)]
    return tuple(names)
