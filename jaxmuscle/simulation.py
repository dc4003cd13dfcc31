"""The only door to diffrax: a machine on its sample clock.

The sampling instants are the loop: the command of row n is held from t_n to t_{n+1} (exact zero-order
hold) and the sensors of row n are read at t_n. Between two samples a diffrax solver takes a fixed number
of steps on the packed state. States may be *imposed*: they then follow the measured signals, linear
between samples, instead of the model. That one device makes the bench-driven rig, the prediction of a
single link with its measured inputs, and the observer that carries the unmeasured states along.
"""

from __future__ import annotations

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.chebyshev import ChebyshevRungeKutta
from jaxmuscle.effects.base import States, initial_states, updated_memories
from jaxmuscle.exponential import ExponentialHeun, propagator
from jaxmuscle.signals import Past


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
    substeps: int,
    keep: tuple[str, ...] = (),
    restarts: Restarts | None = None,
) -> Run:
    """Simulate `samples` samples from `row` on, the states `imposed` following the measured ones.

    Args:
        start: states and memories at `row`; entries for imposed states are not used.
        substeps: solver steps between two samples.
        keep: states whose value at each sample is returned beside the readings.
        restarts: when the run begins anew from what was measured; never when `None`.

    Returns:
        readings and kept states, each with a leading axis of `samples`.
    """
    track_last = track.command.shape[0] - 1
    free = {name: value for name, value in start.state.items() if name not in imposed}
    packed, unpack = ravel_pytree(free)
    width = track.step / substeps
    solver = _solver(actuator, start.state, free, width)

    def sample(carry, index):
        packed, memory = carry
        here = jnp.minimum(row + index, track_last)
        now, then = track.at(here), track.at(here + 1)
        if track.begins is not None:
            packed, memory = _fresh_where(
                track.begins[here], start_at_rest(actuator, track, here), packed, memory, tuple(free)
            )
        if restarts is not None:
            again = index % restarts.period == 0
            packed, memory = _fresh_where(again, restarts.at(here, track), packed, memory, tuple(free))
        held = held_at(actuator, track, here, memory)

        def whole(packed, fraction) -> State:
            path = {name: now[name] + fraction * (then[name] - now[name]) for name in imposed}
            return {**unpack(packed), **path}

        state = whole(packed, 0.0)
        out = actuator.readings(actuator.signals(state, held))
        kept = Start({name: state[name] for name in keep}, memory if keep else {})

        def substep(carry, begin):
            packed, memory = carry
            held = held_at(actuator, track, here, memory)

            @jax.jit  # traced once for all stages of the solver
            def field(t, packed, _):
                rates = actuator.vector_field(whole(packed, t / track.step), held)
                return ravel_pytree({name: rates[name] for name in free})[0]

            if packed.size:
                packed = _solver_step(solver, field, begin, begin + width, packed)
            state = actuator.constrained(whole(packed, (begin + width) / track.step))
            packed = ravel_pytree({name: state[name] for name in free})[0]
            memory = updated_memories(actuator.effects, memory, actuator.signals(state, held), width)
            return (packed, memory), None

        if substeps == 1:
            carry, _ = substep((packed, memory), jnp.zeros(()))
        else:
            carry, _ = jax.lax.scan(substep, (packed, memory), jnp.arange(substeps) * width)
        return carry, (out, kept)

    _, (readings, states) = jax.lax.scan(sample, (packed, start.memory), jnp.arange(samples))
    return Run(readings, states)


def _fresh_where(
    begins: Array, fresh: Start, packed: Array, memory: States, names: tuple[str, ...]
) -> tuple[Array, States]:
    """The packed state and the memories, those of `fresh` where a new stretch begins."""
    anew = ravel_pytree({name: fresh.state[name] for name in names})[0]
    choose = lambda new, old: jnp.where(begins, new, old)  # noqa: E731
    return choose(anew, packed), jax.tree.map(choose, dict(fresh.memory), dict(memory))


def _solver(
    actuator: AbstractActuator, state: State, free: State, width: Array
) -> ChebyshevRungeKutta | ExponentialHeun:
    """The stabilised explicit method; where the machine has a fast linear part, the exponential one."""
    if not actuator.linear_part(state):
        return ChebyshevRungeKutta()
    packed, unpack = ravel_pytree(free)
    still = jax.tree.map(jnp.zeros_like, state)

    def linear(packed: Array) -> Array:
        own = unpack(packed)
        rates = actuator.linear_part({**still, **own})
        return ravel_pytree({name: rates.get(name, still[name]) for name in own})[0]

    return ExponentialHeun(propagator(jax.jacfwd(linear)(jnp.zeros_like(packed)), width))


def _solver_step(
    solver: ChebyshevRungeKutta | ExponentialHeun, field: Any, begin: Array, end: Array, packed: Array
) -> Array:
    term = diffrax.ODETerm(field)
    solver_state = solver.init(term, begin, end, packed, None)
    return solver.step(term, begin, end, packed, None, solver_state, made_jump=False)[0]


def held_at(actuator: AbstractActuator, track: Track, row: Array, memory: States) -> Held:
    """What stays as it is from a sample to the next: the command, its past, the memories of effects."""
    if not actuator.commands:
        return Held(track.command[row], None, memory)
    first = track.first(row)
    before = actuator.resting_command(track.at(jnp.asarray(first)))
    return Held(track.command[row], Past(track.command, row, track.step, before, first), memory)


def observe(actuator: AbstractActuator, track: Track, samples: int, substeps: int = 1) -> Start:
    """The states that are not measured, carried along the whole track by the measured ones.

    Every measured state is imposed; openings, hysteresis, creep and lags run on from rest at the first
    sample. Returns them at every sample (leading axis `samples`).
    """
    imposed = (*actuator.measured, *actuator.derivatives)
    start = start_at_rest(actuator, track)
    hidden = tuple(name for name in start.state if name not in imposed)
    row = jnp.asarray(0)
    return run(
        actuator, track, start, row, samples=samples, imposed=imposed, substeps=substeps, keep=hidden
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
        ).readings

    return jax.vmap(window)(rows)
