"""What the bench did and measured, and the states with which a run begins."""

from __future__ import annotations

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.effects.base import States, initial_states
from jaxmuscle.parameters import split_index
from jaxmuscle.signals import Past


class Track(eqx.Module):
    """What the bench did and measured, on the sample clock, as states of the machine.

    Attributes:
        step: sampling step [s].
        command: held commands, one row a sample; zeros for a rig without a command.
        measured: state → its measured value (smoothed); the rate states are derivatives of these.
        begins: whether a new stretch begins at a sample, with everything unmeasured at rest; `None` for a
            single one.
        widening: how many times as wide as it is dry friction is smoothed, for the first stages of a fit.
    """

    step: Float[Array, ""]
    command: Float[Array, "samples *muscles"]
    measured: dict[str, Float[Array, "samples ..."]]
    begins: Bool[Array, " samples"] | None = None
    widening: Float[Array, ""] | None = None

    def at(self, row: Array) -> State:
        """The measured states at a sample, or at several."""
        last = self.command.shape[0] - 1
        return {name: values[jnp.minimum(row, last)] for name, values in self.measured.items()}

    def first(self, row: Array) -> Array | int:
        """First row of the stretch that a row belongs to."""
        if self.begins is None:
            return 0
        rows = jnp.arange(self.command.shape[0])
        return jnp.max(jnp.where(self.begins & (rows <= row), rows, 0))


class Start(eqx.Module):
    """States and memories at the first sample of a run."""

    state: State
    memory: States


class Restarts(eqx.Module):
    """Every `period` samples a run goes back to what was measured, its other states to `hidden`.

    The period is data: runs of any length of prediction share one compilation.
    """

    period: Int[Array, ""]
    hidden: Start

    def at(self, row: Array, track: Track) -> Start:
        """States and memories with which a run begins anew at `row`."""
        carried = jax.tree.map(lambda values: values[row], self.hidden)
        return Start({**carried.state, **track.at(row)}, carried.memory)


def start_at_rest(actuator: AbstractActuator, track: Track, row: int | Array = 0) -> Start:
    """The measured states of a sample, everything else at rest."""
    state = actuator.rest(track.at(jnp.asarray(row)))
    held = held_at(actuator, track, jnp.asarray(row), {})
    bare = actuator.without_effects(*actuator.effects)
    states, memory = initial_states(actuator.effects, bare.signals(state, held))
    # Once more under the signals that these states make: a lagging sensor starts at the whole force.
    whole = actuator.signals({**state, "effects": states}, held_at(actuator, track, jnp.asarray(row), memory))
    states, memory = initial_states(actuator.effects, whole)
    return Start({**state, "effects": states}, memory)


def with_states(start: Start, values: Mapping[str, Array]) -> Start:
    """A copy in which hidden states have other values: by name, that of an effect by the effect's name.

    An entry of an array goes by its index, ``creep[0]``. `KeyError` for a state that `start` has not.
    """
    state, memory = {**start.state, "effects": dict(start.state["effects"])}, dict(start.memory)
    for path, value in values.items():
        name, index = split_index(path)
        group = next((g for g in (state, state["effects"], memory) if name in g and name != "effects"), None)
        if group is None:
            raise KeyError(name)
        group[name] = jnp.asarray(group[name]).at[index or ()].set(value)
    return Start(state, memory)


def held_at(actuator: AbstractActuator, track: Track, row: Array, memory: States) -> Held:
    """What stays as it is from a sample to the next: the command, its past, the memories of effects."""
    return Held(track.command[row], past_at(actuator, track, row), memory, track.widening)


def past_at(actuator: AbstractActuator, track: Track, row: Array) -> Past | None:
    """The commands before a sample; `None` for a rig without one."""
    if not actuator.commands:
        return None
    first = track.first(row)
    before = actuator.resting_command(track.at(jnp.asarray(first)))
    return Past(track.command, row, track.step, before, first)
