"""A machine on its sample clock.

The sampling instants are the loop: the command of row n is held from t_n to t_{n+1} (exact zero-order
hold) and the sensors of row n are read at t_n. Between two samples a diffrax solver takes a fixed number
of steps on the packed state. States may be *imposed*: they then follow the measured signals, linear
between samples, instead of the model. That one device makes the bench-driven rig, the prediction of a
single link with its measured inputs, and the observer that carries the unmeasured states along.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.effects.base import States, initial_states, updated_memories
from jaxmuscle.exponential import ExponentialHeun
from jaxmuscle.signals import Past
from jaxmuscle.stepping import begin_course, controlled, method_for, step


class Track(eqx.Module):
    """What the bench did and measured, on the sample clock, as states of the machine.

    Attributes:
        step: sampling step [s].
        command: held commands, one row a sample; zeros for a rig without a command.
        measured: state → its measured value (smoothed); the rate states are derivatives of these.
        begins: whether a new stretch begins at a sample, with everything unmeasured at rest; `None` for a
            single one.
    """

    step: Float[Array, ""]
    command: Float[Array, "samples *muscles"]
    measured: dict[str, Float[Array, "samples ..."]]
    begins: Bool[Array, " samples"] | None = None

    def at(self, row: Array) -> State:
        """The measured states at a sample."""
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


class Run(eqx.Module):
    """Readings at the samples of a run, and the states and memories with which each sample begins."""

    readings: dict[str, Array]
    states: Start


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
    packed: bool = True,
) -> Run:
    """Simulate `samples` samples from `row` on, the states `imposed` following the measured ones.

    Args:
        start: states and memories at `row`; entries for imposed states are not used.
        substeps: solver steps between two samples; with a tolerance, the fewest. Traced ones share one
            compilation, and have no reverse mode.
        keep: states whose value at each sample is returned beside the readings.
        restarts: when the run begins anew from what was measured; never when `None`.
        method: a name of `stepping.METHODS`; the machine's own when `None`.
        tolerance: of steps under error control (:func:`jaxmuscle.stepping.controlled`).
        packed: carry the states as one array, which reverse mode needs to be fast; apart, batches of runs
            are two to five times as fast.

    Returns:
        readings and kept states, each with a leading axis of `samples`.
    """
    track_last = track.command.shape[0] - 1
    free = {name: value for name, value in start.state.items() if name not in imposed}
    width = track.step / substeps
    solver = method_for(actuator, start.state, free, width, method)
    pack, unpack = _packing(free, packed or isinstance(solver, ExponentialHeun))

    def sample(carry, index):
        own, memory, course = carry
        here = jnp.minimum(row + index, track_last)
        now, then = track.at(here), track.at(here + 1)
        if track.begins is not None:
            begins = track.begins[here]
            own, memory = _fresh_where(begins, start_at_rest(actuator, track, here), own, memory, pack)
        if restarts is not None:
            again = index % restarts.period == 0
            own, memory = _fresh_where(again, restarts.at(here, track), own, memory, pack)

        def whole(own, fraction) -> State:
            path = {name: now[name] + fraction * (then[name] - now[name]) for name in imposed}
            return {**unpack(own), **path}

        def field_under(memory):
            held = held_at(actuator, track, here, memory)

            @jax.jit  # traced once for all stages of the solver
            def field(t, own, _):
                return pack(actuator.vector_field(whole(own, t / track.step), held))

            return field

        def finish(own, memory, end, size):
            state = actuator.constrained(whole(own, end / track.step))
            signals = actuator.signals(state, held_at(actuator, track, here, memory))
            return pack(state), updated_memories(actuator.effects, memory, signals, size)

        def substep(carry, begin):
            own, memory = carry
            if free:
                own, _ = step(solver, field_under(memory), begin, begin + width, own)
            return finish(own, memory, begin + width, width), None

        state = whole(own, 0.0)
        out = actuator.readings(actuator.signals(state, held_at(actuator, track, here, memory)))
        kept = Start({name: state[name] for name in keep}, memory if keep else {})
        if tolerance is not None:
            is_rate = pack(_rates(actuator, free))
            own, memory, course = controlled(
                solver, field_under, finish, own, memory, track.step, width, tolerance, is_rate, course
            )
        elif isinstance(substeps, Array):
            onward = lambda i, carry: substep(carry, i * width)[0]  # noqa: E731
            own, memory = jax.lax.fori_loop(0, substeps, onward, (own, memory))
        elif substeps == 1:
            (own, memory), _ = substep((own, memory), jnp.zeros(()))
        else:
            (own, memory), _ = jax.lax.scan(substep, (own, memory), jnp.arange(substeps) * width)
        return (own, memory, course), (out, kept)

    own = pack(start.state)
    course = None if tolerance is None else begin_course(width, own)
    _, (readings, states) = jax.lax.scan(sample, (own, start.memory, course), jnp.arange(samples))
    return Run(readings, states)


def _packing(free: State, packed: bool) -> tuple[Callable[[State], Any], Callable[[Any], State]]:
    """From a state to what the solver carries of it, one array or a dictionary, and back."""

    def apart(state: State) -> State:
        return {name: state[name] for name in free}

    if packed:
        return lambda state: ravel_pytree(apart(state))[0], ravel_pytree(free)[1]
    return apart, lambda own: own


def _rates(actuator: AbstractActuator, free: State) -> State:
    """1 for the states that are rates of another, else 0, in the form of the states."""
    return {
        name: jax.tree.map(lambda leaf, rate=name in actuator.derivatives: jnp.full_like(leaf, rate), own)
        for name, own in free.items()
    }


def _fresh_where(
    begins: Array, fresh: Start, own: Any, memory: States, pack: Callable[[State], Any]
) -> tuple[Any, States]:
    """The carried states and the memories, those of `fresh` where a new stretch begins."""
    choose = lambda new, old: jnp.where(begins, new, old)  # noqa: E731
    anew = (pack(fresh.state), dict(fresh.memory))
    return jax.tree.map(choose, anew, (own, dict(memory)))


def held_at(actuator: AbstractActuator, track: Track, row: Array, memory: States) -> Held:
    """What stays as it is from a sample to the next: the command, its past, the memories of effects."""
    if not actuator.commands:
        return Held(track.command[row], None, memory)
    first = track.first(row)
    before = actuator.resting_command(track.at(jnp.asarray(first)))
    return Held(track.command[row], Past(track.command, row, track.step, before, first), memory)


def observe(
    actuator: AbstractActuator, track: Track, samples: int, substeps: int = 1, *, packed: bool = True
) -> Start:
    """The states that are not measured, carried along the whole track by the measured ones.

    Every measured state is imposed; openings, hysteresis, creep and lags run on from rest at the first
    sample. Returns them at every sample (leading axis `samples`).
    """
    imposed = (*actuator.measured, *actuator.derivatives)
    start = start_at_rest(actuator, track)
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
        packed=packed,
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
    packed: bool = True,
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
            packed=packed,
        ).readings

    return jax.vmap(window)(rows)
