"""One run of a machine on its sample clock.

The sampling instants are the loop: the command of row n is held from t_n to t_{n+1} (exact zero-order
hold) and the sensors of row n are read at t_n. Between two samples a diffrax solver takes its steps. States
may be *imposed*: they then follow the measured signals, linear between samples, instead of the model. That
one device makes the bench-driven rig, the prediction of a single link with its measured inputs, and the
observer that carries the unmeasured states along.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmuscle.actuators.base import AbstractActuator, State
from jaxmuscle.effects.base import States
from jaxmuscle.simulation.feedback import Feedback
from jaxmuscle.simulation.interval import Interval
from jaxmuscle.simulation.track import Restarts, Start, Track, past_at, start_at_rest
from jaxmuscle.stepping import Plan, advance, begin_course, method_for


class Run(eqx.Module):
    """Readings at the samples of a run, and the states and memories with which each sample begins.

    `command` is what was held from each sample on.
    """

    readings: dict[str, Array]
    states: Start
    command: Array


class Carry(NamedTuple):
    """What a run carries from sample to sample: states, memories, step control; in a loop also `Loop`."""

    own: State
    memory: States
    course: Any
    loop: Any


class Loop(NamedTuple):
    """State of the controller, the command that is held; and all so far, where an effect reads the past."""

    control: Any
    held: Array
    table: Array | None


class Sample(NamedTuple):
    """What a run knows of a sample beforehand: number, row of the track, command, imposed states."""

    number: Array
    row: Array
    command: Array
    now: State
    then: State


def run(
    actuator: AbstractActuator,
    track: Track,
    start: Start,
    row: Int[Array, ""],
    *,
    samples: int,
    imposed: tuple[str, ...],
    substeps: int | Array,
    keep: tuple[str, ...] = (),
    restarts: Restarts | None = None,
    method: str | None = None,
    tolerance: Float[Array, ""] | None = None,
    feedback: Feedback | None = None,
) -> Run:
    """Simulate `samples` samples from `row` on, the states `imposed` following the measured ones.

    Args:
        start: states and memories at `row`; entries for imposed states are not used.
        substeps: solver steps between two samples; with a tolerance, the fewest. Traced ones share one
            compilation, and have no reverse mode.
        keep: states whose value at each sample is returned beside the readings.
        restarts: when the run begins anew from what was measured; never when `None`.
        method: a name of `stepping.METHODS`; the machine's own when `None`.
        tolerance: of steps under error control (:func:`jaxmuscle.stepping.controlled.in_controlled_steps`).
        feedback: a controller whose commands take the place of the track's. At a sample it is shown
            readings under the command that was held so far (at the first, the track's).

    Returns:
        readings, kept states and commands, each with a leading axis of `samples`.
    """
    free = {name: value for name, value in start.state.items() if name not in imposed}
    width = track.step / substeps
    solver = method_for(actuator, start.state, free, width, method)
    plan = Plan(solver, substeps, width, tolerance, _rates(actuator, free))

    def sample(carry: Carry, at: Sample):
        own, memory, course, loop = carry
        if track.begins is not None:
            fresh = start_at_rest(actuator, track, at.row)
            own, memory = _fresh_where(track.begins[at.row], fresh, own, memory)
        if restarts is not None:
            own, memory = _fresh_where(
                at.number % restarts.period == 0, restarts.at(at.row, track), own, memory
            )
        past = past_at(actuator, track, at.row)
        interval = Interval(actuator, track.step, at.command, past, at.now, at.then, track.widening)
        if loop is not None:
            # Until the controller has spoken, the command is still that of the interval before.
            interval, loop = _under(loop, interval, track, at.row)
        state = interval.whole(own, 0.0)
        readings = actuator.readings(actuator.signals(state, interval.held(memory)))
        kept = Start({name: state[name] for name in keep}, memory if keep else {})
        if feedback is not None and loop is not None:
            control, command = feedback.update(loop.control, readings, at.number)
            interval, loop = _under(Loop(control, command, loop.table), interval, track, at.row)
        own, memory, course = advance(plan, interval.field_under, interval.finish, own, memory, course)
        return Carry(own, memory, course, loop), (readings, kept, interval.command)

    # Without a delay the table would make the loop larger and its cotangent dense, for nothing.
    late = any("past" in effect.reads for effect in actuator.effects.values())
    begin = Carry(
        free,
        start.memory,
        None if tolerance is None else begin_course(width, free),
        None
        if feedback is None
        else Loop(feedback.start, track.command[row], track.command if late else None),
    )
    _, found = jax.lax.scan(sample, begin, _known(track, row, samples, imposed))
    return Run(*found)


def _under(loop: Loop, interval: Interval, track: Track, row: Array) -> tuple[Interval, Loop]:
    """The interval under the command that is held, which is written down."""
    if loop.table is None:
        return dataclasses.replace(interval, command=loop.held), loop
    table = loop.table.at[row].set(loop.held)
    given = eqx.tree_at(lambda track: track.command, track, table)
    past = past_at(interval.actuator, given, row)
    return dataclasses.replace(interval, command=loop.held, past=past), loop._replace(table=table)


def _known(track: Track, row: Array, samples: int, imposed: tuple[str, ...]) -> Sample:
    """What is known of the samples; the last row goes on when the track ends."""
    last = track.command.shape[0] - 1
    rows = jnp.minimum(row + jnp.arange(samples), last)
    now, then = track.at(rows), track.at(rows + 1)
    only = lambda state: {name: state[name] for name in imposed}  # noqa: E731
    return Sample(jnp.arange(samples), rows, track.command[rows], only(now), only(then))


def _rates(actuator: AbstractActuator, free: State) -> State:
    """1 for the states that are rates of another, else 0, in the form of the states."""
    return {
        name: jax.tree.map(lambda leaf, rate=name in actuator.derivatives: jnp.full_like(leaf, rate), own)
        for name, own in free.items()
    }


def _fresh_where(begins: Array, fresh: Start, own: State, memory: States) -> tuple[State, States]:
    """The carried states and the memories, those of `fresh` where a new stretch begins."""
    anew = ({name: fresh.state[name] for name in own}, dict(fresh.memory))
    return jax.tree.map(lambda new, old: jnp.where(begins, new, old), anew, (own, dict(memory)))
