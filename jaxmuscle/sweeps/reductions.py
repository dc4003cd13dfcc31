"""Reductions: numbers that stand for a whole run, so that a million points need no million trajectories."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Inexact

from jaxmuscle._linalg import solve
from jaxmuscle.sweeps.scenario import Trajectory

Samples = Float[Array, "samples *muscles"]
Number = Float[Array, "*muscles"]

BAND = 0.02
"""Half width of the band in which a run has settled, as a share of its whole change."""


def maximum(run: Trajectory, reading: Samples) -> Number:
    """Largest sample."""
    return reading.max(axis=0)


def minimum(run: Trajectory, reading: Samples) -> Number:
    """Smallest sample."""
    return reading.min(axis=0)


def span(run: Trajectory, reading: Samples) -> Number:
    """Largest minus smallest sample."""
    return reading.max(axis=0) - reading.min(axis=0)


def mean(run: Trajectory, reading: Samples) -> Number:
    """Mean of the samples."""
    return reading.mean(axis=0)


def rms(run: Trajectory, reading: Samples) -> Number:
    """Root of the mean square of the samples."""
    return jnp.sqrt(jnp.mean(reading**2, axis=0))


def final(run: Trajectory, reading: Samples) -> Number:
    """Last sample."""
    return reading[-1]


def settling_time(run: Trajectory, reading: Samples) -> Number:
    """Time from the first sample until the reading stays within 2 % of its whole change of its last value."""
    change = jnp.abs(reading[-1] - reading[0])
    outside = jnp.abs(reading - reading[-1]) > BAND * change
    rows = jnp.arange(1, len(reading) + 1).reshape(-1, *[1] * (reading.ndim - 1))
    entered = jnp.max(jnp.where(outside, rows, 0), axis=0)
    return run.time[jnp.minimum(entered, len(reading) - 1)] - run.time[0]


def overshoot(run: Trajectory, reading: Samples) -> Number:
    """How far the reading goes beyond its last value, as a share of its whole change; NaN without one."""
    change = reading[-1] - reading[0]
    beyond = jnp.max((reading - reading[-1]) * jnp.sign(change), axis=0)
    return jnp.where(change == 0, jnp.nan, beyond / jnp.where(change == 0, 1.0, jnp.abs(change)))


def bandwidth(run: Trajectory, reading: Samples) -> Number:
    r"""Frequency at which the response to a step has fallen by 3 dB [Hz].

    :math:`|G(f)| = |\sum Δy\, e^{-i2πft}| / |\sum Δu\, e^{-i2πft}|` of the differences from sample to sample;
    the lowest crossing of :math:`|G(0)|/\sqrt2`, linear between multiples of 1/duration. For a command
    that ends at another level than it begins, in a run that has settled; NaN where nothing crosses.
    """
    pair = (_like(run.command, reading), reading)
    given, shown = (jnp.abs(jnp.fft.rfft(jnp.diff(x, axis=0), axis=0)) for x in pair)
    gain = (shown / given) / (shown[0] / given[0])
    below = gain < jnp.sqrt(0.5)
    after = jnp.argmax(below, axis=0)
    take = lambda row: jnp.take_along_axis(gain, row[None], axis=0)[0]  # noqa: E731
    high, low = take(jnp.maximum(after - 1, 0)), take(after)
    share = (high - jnp.sqrt(0.5)) / jnp.where(high == low, 1.0, high - low)
    duration = (run.time[1] - run.time[0]) * (len(reading) - 1)
    return jnp.where(below.any(axis=0), (after - 1 + share) / duration, jnp.nan)


def gain(run: Trajectory, reading: Samples) -> Number:
    """Amplitude of the reading per amplitude of the command, at the command's frequency, once settled."""
    return jnp.abs(_response(run, reading))


def phase(run: Trajectory, reading: Samples) -> Number:
    """Phase of the reading after that of the command, at the command's frequency, once settled [rad]."""
    return jnp.angle(_response(run, reading))


def _response(run: Trajectory, reading: Samples) -> Inexact[Array, "*muscles"]:
    r"""Ratio of the first harmonics over whole periods of the second half of the run, by least squares.

    A straight line is fitted beside them, so that a slow drift is not taken for a response. A command
    without a frequency, or a run shorter than two periods, gives NaN.
    """
    if run.frequency is None:
        return jnp.full(reading.shape[1:], jnp.nan)
    frequency, begin = run.frequency, run.time[0]
    duration = run.time[-1] - begin
    periods = jnp.floor(0.5 * duration * frequency)
    used = run.time > run.time[-1] - periods / frequency
    angle = 2 * jnp.pi * frequency * run.time
    late = (run.time - begin) / duration - 0.75
    basis = jnp.stack([jnp.ones_like(late), late, jnp.cos(angle), jnp.sin(angle)], axis=1) * used[:, None]
    both = jnp.stack([jnp.broadcast_to(_like(run.command, reading), reading.shape), reading])
    normal = basis.T @ basis + jnp.where(periods > 0, 0.0, 1.0) * jnp.eye(4)
    right = jnp.einsum("nk,bn...->kb...", basis, both).reshape(4, -1)
    # Not by LAPACK, of which jaxlib 0.10 lets several batches at a time wait for each other.
    fit = jax.vmap(solve, in_axes=(None, 1), out_axes=1)(normal, right)
    harmonic = (fit[2] - 1j * fit[3]).reshape(2, *reading.shape[1:])
    return jnp.where(periods > 0, harmonic[1] / harmonic[0], jnp.nan)


def _like(command: Array, reading: Array) -> Array:
    """The command of each muscle for a reading of each muscle, that of the first for a single reading."""
    if command.ndim == reading.ndim:
        return command
    return command[:, 0] if command.ndim > reading.ndim else command[:, None]


@dataclasses.dataclass(frozen=True)
class Reduction:
    """A function of a run and of one of its readings; `unit` takes {reading} and {command}.

    `point`: whether it is a point on the reading's scale, not a distance on it: absolute where that is.
    """

    function: Callable[[Trajectory, Samples], Number]
    unit: str
    point: bool = False

    @property
    def name(self) -> str:
        """Name by which it is asked for."""
        return self.function.__name__

    @property
    def meaning(self) -> str:
        """What it is, on one line."""
        return (self.function.__doc__ or "").strip().splitlines()[0].rstrip(".")


CATALOGUE = (
    *(Reduction(function, "{reading}", function is not span) for function in (maximum, minimum, span)),
    *(Reduction(function, "{reading}", point=True) for function in (mean, rms, final)),
    Reduction(settling_time, "s"),
    Reduction(overshoot, ""),
    Reduction(bandwidth, "Hz"),
    Reduction(gain, "{reading}/{command}"),
    Reduction(phase, "rad"),
)
BY_NAME = {reduction.name: reduction for reduction in CATALOGUE}
