"""State of a simulation between two samples: all that a run needs in order to go on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.simulation.track import (
    Start,
    Track,
    command_before,
    commanded_track,
    hidden_start,
    is_measured,
    reads,
    start_at_rest,
    with_states,
)


class SimulationState(eqx.Module):
    """What a machine carries from a sample to the next, SI; a run that starts from it goes on.

    A tree of arrays: it may be mapped over, differentiated, and carried by a scan.

    Attributes:
        rig: name of the rig.
        remembers: whether it holds the commands before the last one, for a machine that asks for them.
        begin: states and memories; :attr:`values` has them by name.
        commands: those that were given, the last one last: as many as the machine's effects may still ask for
            (a delay), at least the one that is held.
        before: command before these; NaN where others have been forgotten.
        step: sampling step of the commands [s].
        time: since the simulation began [s].
    """

    rig: str = eqx.field(static=True)
    remembers: bool = eqx.field(static=True)
    begin: Start
    commands: Float[Array, "given *muscles"]
    before: Float[Array, "*muscles"]
    step: Float[Array, ""]
    time: Float[Array, ""]

    @property
    def values(self) -> dict[str, Any]:
        """Name of a state → its value: those of the machine, and of effects by the effect's name."""
        return named_states(self.begin)


def named_states(start: Start) -> dict[str, Any]:
    """States and memories by name, those of effects by the effect's name."""
    own = {name: value for name, value in start.state.items() if name != "effects"}
    return {**own, **start.state.get("effects", {}), **start.memory}


def first_state(
    actuator: AbstractActuator, step: Array, start: Mapping[str, ArrayLike], given: int
) -> SimulationState:
    """A machine at rest, or with some states as in `start`, that remembers `given` commands.

    Raises:
        InputError: a state that the machine has not, a value of another shape.
    """
    width = (len(actuator.commands),) if len(actuator.commands) > 1 else ()
    measured = {name: value for name, value in start.items() if is_measured(actuator, name)}
    others = {name: value for name, value in start.items() if name not in measured}
    try:
        track = commanded_track(actuator, jnp.zeros((1, *width)), step, measured)
        hidden = hidden_start(actuator, track, others)
    except ValueError as error:
        raise InputError(f"start: {error}") from error
    rest = jnp.broadcast_to(command_before(actuator, track, 0), width)
    held = dataclasses.replace(track, command=rest[None])
    begin = with_states(start_at_rest(actuator, held), hidden)
    # A number that was written in Python would, at the next step, be of another type.
    begin = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=leaf.dtype), begin)
    commands = jnp.broadcast_to(rest, (given, *width))
    late = reads(actuator, "past")
    return SimulationState(actuator.rig, late, begin, commands, rest, step, jnp.zeros_like(step))


def resumed_track(actuator: AbstractActuator, track: Track, state: SimulationState) -> tuple[Track, int]:
    """A track that begins with the commands that a state remembers, and the row at which to go on."""
    if not reads(actuator, "past"):
        return dataclasses.replace(track, begin_time=state.time, before=state.before), 0
    given = len(state.commands)
    whole = lambda values: jnp.concatenate([jnp.repeat(values[:1], given, axis=0), values])  # noqa: E731
    begins = track.begins
    return dataclasses.replace(
        track,
        command=jnp.concatenate([state.commands, track.command]),
        measured={name: whole(values) for name, values in track.measured.items()},
        begins=None if begins is None else jnp.concatenate([jnp.zeros(given, bool), begins]),
        begin_time=state.time - given * track.step,
        before=state.before,
        differences={name: whole(values) for name, values in track.differences.items()},
    ), given


def state_at(
    actuator: AbstractActuator, track: Track, begin: Start, row: int, given: int | None = None
) -> SimulationState:
    """The state at a row of a track, before the command of that row is held.

    Args:
        begin: states and memories there.
        given: how many commands it remembers; when `None` all of the track if an effect reads them, else the
            last one.
    """
    late, before = reads(actuator, "past"), command_before(actuator, track, 0)
    if given is None:
        given = row if late else 1
    forgotten = max(row - given, 0)
    commands, lost = track.command[forgotten:row], track.command[:forgotten]
    if late and forgotten:
        # What the machine rests under is known however long ago it was.
        before = jnp.where((lost == before).all(axis=0), before, jnp.nan)
    return SimulationState(
        actuator.rig, late, begin, commands, before, track.step, track.time(jnp.asarray(row))
    )


Form = tuple[Any, tuple[tuple[int, ...], ...]]


def form_of(start: Start) -> Form:
    """Structure and shapes of states and memories, to be compared."""
    return jax.tree.structure(start), tuple(np.shape(leaf) for leaf in jax.tree.leaves(start))


def form_at_rest(actuator: AbstractActuator) -> Form:
    """The form that the states of a machine have."""
    step = jax.ShapeDtypeStruct((), float)
    rest = eqx.filter_eval_shape(lambda actuator, step: first_state(actuator, step, {}, 1), actuator, step)
    return form_of(rest.begin)


def check_state(actuator: AbstractActuator, state: SimulationState, step: float, form: Form) -> None:
    """Look at a state before a machine goes on from it.

    Args:
        step: sampling step with which it goes on [s].
        form: that the machine's states have.

    Raises:
        InputError: it is none, of another rig or of a machine with other effects; commands at another step
            where an effect asks for these.
    """
    if not isinstance(state, SimulationState):
        raise InputError(f"expected a state of a simulation (SimulationState); got {type(state).__name__}")
    if state.rig != actuator.rig:
        raise InputError(f"expected a state of rig {actuator.rig!r}; got one of rig {state.rig!r}")
    if form_of(state.begin) != form:
        found = ", ".join(f"{name} {np.shape(v)}" for name, v in named_states(state.begin).items())
        raise InputError(
            f"expected a state of this machine, rig {actuator.rig!r} with effects "
            f"{', '.join(actuator.effects) or '-'}; got one with the states {found}"
        )
    if not reads(actuator, "past"):
        return
    if not state.remembers:
        raise InputError(
            "the machine has a delay: expected a state that remembers the commands before it; got one of a "
            "machine without"
        )
    if isinstance(state.step, jax.core.Tracer):
        return
    if abs(float(state.step) - step) > 1e-6 * step:
        raise InputError(
            f"the machine has a delay, and the state remembers commands that were {float(state.step):g} s "
            f"apart: expected that step to go on with; got {step:g} s"
        )
