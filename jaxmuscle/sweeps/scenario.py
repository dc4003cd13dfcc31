"""Scenario of a sweep: an actuator under a command on a clock, checked, and the run that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameter_names import COMMAND
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.simulation import Track, run, start_at_rest
from jaxmuscle.simulation.observed import observed
from jaxmuscle.simulation.sensor_errors import true_track
from jaxmuscle.simulation.track import commanded_track, sampling_step
from jaxmuscle.sweeps.commands import Sine, command_of


class Bench(eqx.Module):
    """A machine and what is done to it.

    Attributes:
        actuator: the machine.
        command: a function of time, a table with one row a sample, or the track of a recording.
        start: measured states at the first sample; the others at rest. Not used with a recording.
        times: sampling instants [s], uniform.
        step: their distance [s].
    """

    actuator: AbstractActuator
    command: Callable[[Any], Array] | Float[Array, "samples *muscles"] | Track
    start: dict[str, Array]
    times: Float[Array, " samples"]
    step: Float[Array, ""]

    def track(self) -> Track:
        """What the bench does, on the sample clock."""
        if isinstance(self.command, Track):
            return true_track(self.actuator, self.command)
        table = jax.vmap(self.command)(self.times) if callable(self.command) else self.command
        return commanded_track(self.actuator, self._for_each_muscle(table), self.step, self.start)

    def trajectory(self, substeps: int, method: str | None = None) -> Trajectory:
        """The run from the start on, with `substeps` steps of a method between two samples."""
        track, machine = self.track(), self.actuator
        begin, row = start_at_rest(machine, track), jnp.asarray(0)
        done = run(
            machine,
            track,
            begin,
            row,
            samples=track.command.shape[0],
            imposed=machine.imposed,
            substeps=substeps,
            method=method,
        )
        return Trajectory(self.times, track.command, done.readings, getattr(self.command, "frequency", None))

    def _for_each_muscle(self, table: Array) -> Array:
        """One column a muscle; the same for all where the command gives only one."""
        muscles = len(self.actuator.commands)
        return jnp.broadcast_to(table[:, None], (len(table), muscles)) if muscles > table[0].size else table


class Trajectory(eqx.Module):
    """What a reduction is given: one run, SI, pressures absolute.

    Attributes:
        time: sampling instants [s].
        command: held command of each sample.
        readings: reading → samples.
        frequency: of the command [Hz], where it has one.
    """

    time: Float[Array, " samples"]
    command: Float[Array, "samples *muscles"]
    readings: dict[str, Float[Array, "samples ..."]]
    frequency: Float[Array, ""] | None = None


DURATION = 2.0
"""Length of the runs when no instants are given [s]."""


def bench_of(
    actuator: AbstractActuator,
    over: Any,
    command: Any,
    times: ArrayLike | Sequence[float] | None,
    start: Mapping[str, Any],
) -> Bench:
    """The bench that :func:`jaxmuscle.sweeps.sweep` describes.

    Raises:
        InputError: a rig without a command, times that are not uniform, a command of another shape than
            the rig's, an unknown state in `start`.
    """
    if isinstance(command, Recording):
        if times is not None or start:
            raise InputError("a recording has its own instants and start; leave out times= and start=")
        track = observed(actuator, command, command.card.noise).track
        return Bench(actuator, track, {}, jax.device_put(command.time), track.step)
    if actuator.imposed:
        raise InputError(f"rig {actuator.rig!r} has no command: its bench moves it; give command=recording")
    clock = np.arange(0.0, DURATION, actuator.largest_step) if times is None else np.asarray(times, float)
    try:
        step = sampling_step(clock)
    except ValueError as error:
        raise InputError(f"times: {error}") from error
    given = _command(actuator, over, command, clock)
    return Bench(
        actuator, given, _start(actuator, start), jax.device_put(clock), jax.device_put(np.asarray(step))
    )


def _command(actuator: AbstractActuator, over: Any, command: Any, clock: np.ndarray) -> Any:
    muscles = len(actuator.commands)
    if command is None:
        if muscles > 1:
            raise InputError(f"rig {actuator.rig!r} has {muscles} commands; say what they are with command=")
        return Sine()
    if not callable(command):
        shape = (len(clock), muscles) if muscles > 1 else clock.shape
        table = np.asarray(command, dtype=float)
        if table.shape != shape:
            raise InputError(f"command: expected a table of shape {shape}, a row a sample; got {table.shape}")
        return jax.device_put(table)
    made: Any = command if isinstance(command, eqx.Module) else command_of(command, _swept(over))
    try:
        shape = jax.eval_shape(made, jax.ShapeDtypeStruct((), float)).shape
    except (TypeError, jax.errors.JAXTypeError) as error:
        raise InputError(f"command: cannot be computed at an instant with JAX: {error}") from error
    if shape not in ((), (muscles,) if muscles > 1 else ()):
        wanted = f"a number or {muscles} numbers" if muscles > 1 else "a number"
        raise InputError(f"command: expected {wanted} at an instant; got an array of shape {shape}")
    return made


def _swept(over: Any) -> Iterable[str]:
    """Parameters of the command that are swept."""
    names = over if isinstance(over, Mapping) else over[0] if over else ()
    return [name.removeprefix(COMMAND) for name in names if str(name).startswith(COMMAND)]


def _start(actuator: AbstractActuator, start: Mapping[str, Any]) -> dict[str, Array]:
    known = {**actuator.measured, **actuator.derivatives}
    found = {}
    for name, value in start.items():
        if name not in known:
            raise InputError(f"start: unknown state {name!r}{nearest(name, known)}")
        columns = actuator.measured[actuator.derivatives.get(name, name)]
        shape = (len(columns),) if len(columns) > 1 else ()
        array = np.asarray(value, dtype=float)
        if array.shape not in ((), shape) or not np.isfinite(array).all():
            raise InputError(f"start: {name}: expected finite numbers of shape {shape}; got {value}")
        found[name] = jax.device_put(np.broadcast_to(array, shape))
    return found
