"""Track of a run: commands and measured states over time, and the initial states with which a run begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.sensing import sensing
from jaxmuscle.effects.base import States
from jaxmuscle.effects.chain import initial_states
from jaxmuscle.parameters import entries_of, raised, split_index
from jaxmuscle.signals import Past


class StartError(eqx.Module):
    """How a state that is told by the past alone differs from the smoothed one, at every sample.

    Attributes:
        offset: what it is above the smoothed one.
        spread: its standard deviation.
    """

    offset: Float[Array, "samples ..."]
    spread: Float[Array, "samples ..."]


class Track(eqx.Module):
    """What the bench did and measured, on the sample clock, as states of the machine.

    Attributes:
        step: sampling step [s].
        command: held commands, one row a sample; zeros for a rig without a command.
        measured: state → its measured value (smoothed); the rate states are derivatives of these.
        begins: whether a new stretch begins at a sample, with everything unmeasured at rest; `None` for a
            single one.
        widening: how many times as wide as it is dry friction is smoothed, for the first stages of a fit.
        is_true: whether the measured states are freed of what sensors do to their readings
            (:func:`jaxmuscle.simulation.sensor_errors.true_track`).
        begin_time: of row 0, since the simulation began [s]; 0 when `None`.
        before: command before row 0; that under which the machine rests there when `None`.
        differences: path of a number of the machine → by how much it is larger at a sample than the machine
            says, where recordings under several values (a mass, a length) were joined.
        start_errors: measured state, or rate of one, → what it is off where a run begins with it as the past
            tells it; none where runs begin with the smoothed states.
    """

    step: Float[Array, ""]
    command: Float[Array, "samples *muscles"]
    measured: dict[str, Float[Array, "samples ..."]]
    begins: Bool[Array, " samples"] | None = None
    widening: Float[Array, ""] | None = None
    is_true: bool = eqx.field(static=True, default=False)
    begin_time: Float[Array, ""] | None = None
    before: Float[Array, "*muscles"] | None = None
    differences: dict[str, Float[Array, " samples"]] = eqx.field(default_factory=dict)
    start_errors: dict[str, StartError] = eqx.field(default_factory=dict)

    def time(self, row: Array) -> Array:
        """Seconds since the simulation began at a row, or at several."""
        passed = row * self.step
        return passed if self.begin_time is None else self.begin_time + passed

    def at(self, row: Array) -> State:
        """The measured states at a sample, or at several."""
        last = self.command.shape[0] - 1
        return {name: values[jnp.minimum(row, last)] for name, values in self.measured.items()}

    def at_start(self, row: Array) -> State:
        """The measured states with which a run begins at a sample."""
        here = jnp.minimum(row, self.command.shape[0] - 1)
        found = self.at(row)
        return found | {name: found[name] + error.offset[here] for name, error in self.start_errors.items()}

    def start_spread(self, name: str, smoothed: ArrayLike) -> NDArray[np.float64]:
        """Standard deviation of a measured state where a run begins with it, at every sample.

        Args:
            smoothed: that of the smoothed state.
        """
        error = self.start_errors.get(name)
        return np.asarray(smoothed if error is None else error.spread)

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
        return Start({**carried.state, **track.at_start(row)}, carried.memory)


def machine_at(actuator: AbstractActuator, track: Track, row: int | Array) -> AbstractActuator:
    """The machine as it is at a sample: itself, or with the values that differ between joined recordings."""
    here = jnp.minimum(row, track.command.shape[0] - 1)
    return raised(actuator, {path: by[here] for path, by in track.differences.items()})


def start_at_rest(actuator: AbstractActuator, track: Track, row: int | Array = 0) -> Start:
    """The measured states of a sample, everything else at rest under the command before it."""
    here = jnp.asarray(row)
    actuator = machine_at(actuator, track, here)
    state, held = actuator.rest(track.at(here)), _held_before(actuator, track, here, {})
    bare = actuator.without_effects(*actuator.effects)
    states, memory = initial_states(actuator.effects, sensing(actuator, bare.signals(state, held)))
    # Once more under the signals that these states make: a lagging sensor starts at the whole force.
    whole = actuator.signals({**state, "effects": states}, _held_before(actuator, track, here, memory))
    states, memory = initial_states(actuator.effects, sensing(actuator, whole))
    begun = {name: value for name, value in track.at_start(here).items() if name in track.start_errors}
    return Start({**state, **begun, "effects": states}, memory)


def _held_before(actuator: AbstractActuator, track: Track, row: Array, memory: States) -> Held:
    """What is held at the beginning of a stretch, with the command before it."""
    held = held_at(actuator, track, row, memory)
    if held.past is None:
        return held
    past = dataclasses.replace(held.past, row=held.past.first - 1)
    return dataclasses.replace(held, command=past(jnp.zeros(())), past=past)


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
    past, time = past_at(actuator, track, row), time_at(actuator, track, row)
    return Held(track.command[row], past, memory, track.widening, time)


def time_at(actuator: AbstractActuator, track: Track, row: Array) -> Array | None:
    """Seconds since the simulation began at a sample; `None` where no effect reads the time."""
    return track.time(row) if reads(actuator, "time") else None


def reads(actuator: AbstractActuator, signal: str) -> bool:
    """Whether an effect of the machine reads a signal."""
    return any(signal in effect.reads for effect in actuator.effects.values())


def past_at(actuator: AbstractActuator, track: Track, row: Array) -> Past | None:
    """The commands before a sample; `None` for a rig without one."""
    if not actuator.commands:
        return None
    first = track.first(row)
    return Past(track.command, row, track.step, command_before(actuator, track, first), first)


def command_before(actuator: AbstractActuator, track: Track, first: Array | int) -> Array:
    """The command before a stretch that begins at row `first`; zero for a rig without one."""
    if not actuator.commands:
        return jnp.zeros(())
    if track.before is not None and track.begins is None:
        return track.before
    resting = machine_at(actuator, track, first).resting_command(track.at(jnp.asarray(first)))
    return resting if track.before is None else jnp.where(jnp.asarray(first) == 0, track.before, resting)


def with_earlier_commands(track: Track, time: float) -> Track:
    """A copy whose commands come a time [s] earlier: between samples on a straight line, held at the end of
    a stretch. Outside of compiled programs.
    """
    command, samples = np.asarray(track.command), track.command.shape[0]
    begins = np.zeros(samples, dtype=bool) if track.begins is None else np.asarray(track.begins)
    edges = [0, *(np.flatnonzero(begins[1:]) + 1).tolist(), samples]
    columns = command.reshape(samples, -1).copy()
    for first, end in zip(edges[:-1], edges[1:], strict=True):
        rows = np.arange(first, end)
        for values in columns[first:end].T:
            values[:] = np.interp(rows + time / float(track.step), rows, values.copy())
    return dataclasses.replace(track, command=jnp.asarray(columns.reshape(command.shape)))


def sampling_step(times: ArrayLike) -> float:
    """The step of uniform sampling instants [s]; `ValueError` when they are not at least two and uniform."""
    steps = np.diff(np.asarray(times, dtype=float))
    if steps.ndim != 1 or len(steps) < 1 or steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        raise ValueError("expected at least two uniform, increasing instants")
    # Differences of instants are wrong in their last places, in each part of a clock otherwise: a part that
    # goes on where another ended has the same step.
    return float(f"{steps.mean():.12g}")


def commanded_track(
    actuator: AbstractActuator, command: Array, step: Array, start: Mapping[str, ArrayLike]
) -> Track:
    """The track of a command of shape (samples, *muscles) from `start`, else from what the rig rests at.

    The step, the command, the start and the actuator may be traced. `ValueError` for an unknown start, or one
    of another shape than the state's.
    """
    states = {name: actuator.at_rest(name) for name in (*actuator.measured, *actuator.derivatives)}
    known = {path for name, value in states.items() for path in (name, *entries_of(name, value))}
    if unknown := set(start) - known:
        raise ValueError(f"unknown start {sorted(unknown)}; expected some of {sorted(states)}")
    for path, value in start.items():
        name, index = split_index(path)
        whole, shape = jnp.asarray(value, dtype=float), states[name][index or ()].shape
        if whole.shape not in ((), shape):
            raise ValueError(f"start of {path}: expected the shape {shape}; got {whole.shape}")
        states[name] = states[name].at[index or ()].set(whole)
    samples = command.shape[0]
    measured = {name: jnp.broadcast_to(value, (samples, *value.shape)) for name, value in states.items()}
    return Track(step, command, measured)


def is_measured(actuator: AbstractActuator, name: str) -> bool:
    """Whether a state, or an entry of one (``pressure[1]``), is measured or the rate of a measured one."""
    return split_index(name)[0] in {*actuator.measured, *actuator.derivatives}


def hidden_start(
    actuator: AbstractActuator, track: Track, given: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """The values `given` to states that are not measured, as arrays of the shapes of these states.

    Raises:
        ValueError: no such state, no such entry of it, or a value of another shape.
    """
    if not given:
        return {}
    rest = jax.eval_shape(lambda actuator, track: start_at_rest(actuator, track), actuator, track)
    states = {**rest.state, **rest.state["effects"], **rest.memory}
    # A lag's or a play operator's state is one array; that of an effect with several has no name for each.
    shapes = {name: v.shape for name, v in states.items() if isinstance(v, jax.ShapeDtypeStruct)}
    known = {path: () for name, shape in shapes.items() for path in entries_of(name, jnp.empty(shape))}
    known |= shapes
    if unknown := set(given) - set(known):
        raise ValueError(f"unknown start {sorted(unknown)}; expected some of {sorted(shapes)}")
    values = {name: jnp.asarray(value, dtype=float) for name, value in given.items()}
    for name, value in values.items():
        if value.shape not in ((), known[name]):
            raise ValueError(f"start of {name}: expected the shape {known[name]}; got {value.shape}")
    return {name: jnp.broadcast_to(value, known[name]) for name, value in values.items()}
