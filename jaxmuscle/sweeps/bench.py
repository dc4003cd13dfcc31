"""One operating point: a machine under a command, and the run that they make."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.recordings.commanded import commanded_track
from jaxmuscle.simulation import Track, run, start_at_rest


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
            return self.command
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
