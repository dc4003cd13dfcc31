"""Simulation of an actuator on its sample clock: one run, a controller in the loop, the observer of hidden
states, and many short predictions along one track.

The sampling instants are the loop: the command of row n is held from t_n to t_{n+1} (exact zero-order
hold) and the sensors of row n are read at t_n. Between two samples a diffrax solver takes its steps. States
may be *imposed*: they then follow the measured signals, linear between samples, instead of the model. That
one device makes the bench-driven rig, the prediction of a single link with its measured inputs, and the
observer that carries the unmeasured states along.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmuscle.actuators.actuator import AbstractActuator, State
from jaxmuscle.effects.base import States
from jaxmuscle.simulation.command_switch import switch_of
from jaxmuscle.simulation.forward_mode import depending_on, linearised_scan
from jaxmuscle.simulation.interval import Interval, readings_of
from jaxmuscle.simulation.sensor_errors import Readings, readings_now, shown_readings, without_sensor_errors
from jaxmuscle.simulation.solvers import method_for
from jaxmuscle.simulation.stepping import Plan, advance, begin_course
from jaxmuscle.simulation.track import (
    Restarts,
    Start,
    Track,
    machine_at,
    past_at,
    reads,
    start_at_rest,
    time_at,
)

Derivatives = Literal["any", "forward", "linearised"]
"""Derivatives that a run is laid out for: in either mode; in forward mode with several tangents, which is
traced faster; and computed apart from the values, which runs faster where many numbers are predicted side by
side, and compiles slower (:func:`jaxmuscle.simulation.forward_mode.linearised_scan`)."""


class Feedback(eqx.Module):
    """A sampled controller as a run takes it.

    Attributes:
        start: its state at the first sample, any tree of arrays.
        update: (state, readings at a sample, number of the sample) → (state, command until the next).
    """

    start: Any
    update: Callable[[Any, Readings, Array], tuple[Any, Array]]


class Run(eqx.Module):
    """Readings at the samples of a run, and the states and memories with which each sample begins.

    `command` is what was held from each sample on, `final` where the last one led to.
    """

    readings: dict[str, Array]
    states: Start
    command: Array
    final: Start


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
    derivatives: Derivatives = "any",
) -> Run:
    """Simulate `samples` samples from `row` on, the states `imposed` following the measured ones.

    Args:
        start: states and memories at `row`; entries for imposed states are not used.
        substeps: solver steps between two samples; with a tolerance, the fewest. Traced ones share one
            compilation, and have no reverse mode.
        keep: states whose value at each sample is returned beside the readings.
        restarts: when the run begins anew from what was measured; never when `None`.
        method: a name of `stepping.METHODS`; the machine's own when `None`.
        tolerance: of steps under error control (:func:`jaxmuscle.simulation.stepping.in_controlled_steps`).
        feedback: a controller whose commands take the place of the track's. At a sample it is shown
            readings under the command that was held so far (at the first, the track's).
        derivatives: of the readings by numbers of the actuator, as they will be taken.

    Returns:
        readings as the sensors show them, kept states and commands, each with a leading axis of `samples`;
        and states and memories one step after the last sample.
    """
    whole, actuator = actuator, without_sensor_errors(actuator)
    free = {name: value for name, value in start.state.items() if name not in imposed}
    width = track.step / substeps
    solver = method_for(actuator, start.state, free, width, method)
    switch = switch_of(actuator, track.step, substeps, solver) if tolerance is None else None
    plan = Plan(solver, substeps, width, tolerance, _rates(actuator, free), derivatives == "any", switch)
    apart = feedback is not None and derivatives == "linearised"

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
        time = time_at(actuator, track, at.row)
        here = machine_at(actuator, track, at.row)
        interval = Interval(here, track.step, at.command, past, at.now, at.then, track.widening, time)
        if loop is not None:
            # Until the controller has spoken, the command is still that of the interval before.
            interval, loop = _under(loop, interval, track, at.row)
        state = interval.whole(own, 0.0)
        states = {**state.get("effects", {}), **memory}
        readings = readings_of(here, state, interval.held(memory), states)
        kept = Start({name: state[name] for name in keep}, memory if keep else {})
        if feedback is not None and loop is not None:
            shown = readings_now(whole, readings, track, at.row)
            control, command = feedback.update(loop.control, shown, at.number)
            interval, loop = _under(Loop(control, command, loop.table), interval, track, at.row)
        field_under = interval.field_under if not apart else _apart(interval.field_under)
        own, memory, course = advance(plan, field_under, interval.finish, own, memory, course)
        return Carry(own, memory, course, loop), (readings, kept, interval.command)

    steps = None if tolerance is None else begin_course(width, free)
    begin = Carry(free, start.memory, steps, _first_loop(actuator, track, row, feedback))
    if derivatives != "any":
        begin = depending_on(actuator, begin)
    scan = linearised_scan if derivatives == "linearised" else jax.lax.scan
    end, (readings, states, commands) = scan(sample, begin, _known(track, row, samples, imposed))
    there = track.at(row + samples)
    final = Start({**end.own, **{name: there[name] for name in imposed}}, end.memory)
    return Run(shown_readings(whole, readings, track, row), states, commands, final)


def _apart(field_under: Callable[..., Any]) -> Callable[..., Any]:
    """The field whose states and rates are kept, each once.

    XLA merges what a stage of the solver computes into each of its uses in the next ones, three times as
    many operations as there are where tangents are carried through a controller: cost and gradient by six
    gains of a joint in closed loop take 1.4 in place of 1.9 ms a scenario so.
    """

    def under(memory: States, switched: Array | None = None) -> Callable[[Any, State, Any], State]:
        field = field_under(memory, switched)
        keep = jax.lax.optimization_barrier
        return lambda t, own, nothing: keep(field(t, keep(own), nothing))

    return under


def _first_loop(
    actuator: AbstractActuator, track: Track, row: Array, feedback: Feedback | None
) -> Loop | None:
    """The controller at the first sample, the track's command held; `None` without a controller."""
    if feedback is None:
        return None
    # Without a delay the table would make the loop larger and its cotangent dense, for nothing.
    table = track.command if reads(actuator, "past") else None
    return Loop(feedback.start, track.command[row], table)


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


def observe(
    actuator: AbstractActuator,
    track: Track,
    samples: int,
    substeps: int = 1,
    start: Start | None = None,
    derivatives: Derivatives = "any",
) -> Start:
    """The states that are not measured, carried along the whole track by the measured ones.

    Every measured state is imposed; openings, hysteresis, creep and lags run on from `start`, else
    from rest at the first sample. Returns them at every sample (leading axis `samples`).
    """
    imposed = (*actuator.measured, *actuator.derivatives)
    start = start_at_rest(actuator, track) if start is None else start
    hidden = tuple(name for name in start.state if name not in imposed)
    row = jnp.asarray(0)
    return run(
        actuator,
        track,
        start,
        row,
        samples=samples,
        imposed=imposed,
        substeps=substeps,
        keep=hidden,
        derivatives=derivatives,
    ).states


def predict(
    actuator: AbstractActuator,
    track: Track,
    rows: Int[Array, " windows"],
    *,
    samples: int,
    imposed: tuple[str, ...],
    substeps: int,
    hidden: Start,
    period: Int[Array, ""] | None = None,
    derivatives: Derivatives = "any",
) -> dict[str, Array]:
    """Readings of windows of `samples` samples, each started at its row from the measured state.

    The states that are not measured start from `hidden`, as :func:`observe` gives them; all start anew
    every `period` samples, if one is given. Returns readings with leading axes (windows, samples).
    """
    restarts = Restarts(jnp.asarray(samples if period is None else period), hidden)

    def window(row: Array) -> dict[str, Array]:
        return run(
            actuator,
            track,
            restarts.at(row, track),
            row,
            samples=samples,
            imposed=imposed,
            substeps=substeps,
            restarts=None if period is None else restarts,
            derivatives=derivatives,
        ).readings

    return jax.vmap(window)(rows)
