"""Explanations of a force that comes later than the measured pressure: lag, delay, air line.

An air line between the pressure gauge and the muscle has a transit time T, a time τ in which the muscle's
volume fills through it (volume over that of the line, times T), and a loss R at its inlet (over the wave
impedance of the line); the flow in it being linear,

    P_muscle / P_gauge = 1 / (cosh sT + sτ sinh sT + R (sinh sT + sτ cosh sT)).

For R = 0 it is the lossless line closed by a volume, for R = 1 a delay and a lag in a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from fast_force_switches import AFTER, BEFORE, Switch
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from psu_isometric import Series
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, least_squares, minimize_scalar

from jaxmuscle.effects import ForceSensorLag
from jaxmuscle.signals import Signals

RINGING = (0.04, 0.25)
"""After the valve has closed [s]."""
DELAYS: Series = np.arange(-0.008, 0.0355, 1e-3, dtype=np.float64)
LAGS: Series = np.arange(0, 0.0455, 1e-3, dtype=np.float64)
"""Values at which the error of a delay and of a lag is worked out [s]."""
GRID = np.arange(-0.4, AFTER, 1e-3)
FREQUENCIES = np.arange(14, 70, 0.25)
LONGEST = round(1e3 * (BEFORE + AFTER)) + 1
"""Samples of a switch at most: the clock counts milliseconds."""
RESAMPLED = 200


def delay_errors(switch: Switch) -> Series:
    """Sum of squares over the judged samples, for each of `DELAYS` [N²]."""
    at, force = switch.time[switch.judged], switch.force[switch.judged]
    shifted = np.interp(at - DELAYS[:, None], switch.time, switch.pressure)
    return np.sum((switch.static(shifted) - force) ** 2, axis=1)


@jax.jit
def _lagged(force: jax.Array, steps: jax.Array) -> jax.Array:
    """Readings of a force sensor with each of `LAGS` as its time constant."""

    def reading(time_constant: jax.Array) -> jax.Array:
        sensor = ForceSensorLag(time_constant=time_constant)

        def sample(memory: Any, row: Any) -> tuple[Any, jax.Array]:
            signals = Signals(force=row[0])
            memory = sensor.update(memory, signals, row[1])
            return memory, row[0] + sensor.value(memory, signals)

        return jax.lax.scan(sample, sensor.initial(Signals(force=force[0])), (force[1:], steps))[1]

    return jax.vmap(reading)(jnp.asarray(LAGS))


def lag_errors(switch: Switch) -> Series:
    """Sum of squares over the judged samples, for each of `LAGS` [N²]."""
    missing = LONGEST - len(switch.time)  # one length, one compilation
    static = np.pad(switch.static(switch.pressure), (0, missing), mode="edge")
    steps = np.pad(np.diff(switch.time), (0, missing), constant_values=1e-3)
    reading = np.asarray(_lagged(jnp.asarray(static), jnp.asarray(steps)))[:, : len(switch.time) - 1]
    judged = switch.judged[1:]
    return np.sum((reading[:, judged] - switch.force[1:][judged]) ** 2, axis=1)


def best(values: Series, errors: Series) -> float:
    """Value of the smallest error, between the values at which it is known."""
    curve, row = CubicSpline(values, errors), int(np.clip(np.argmin(errors), 1, len(values) - 2))
    return float(
        minimize_scalar(curve, bounds=(values[row - 1], values[row + 1]), method="bounded").x  # type: ignore
    )


def rms_at(values: Series, errors: Series, value: float, samples: int) -> float:
    """Root mean square at one value, of the errors of some switches (one a row) with so many samples."""
    return float(np.sqrt(CubicSpline(values, errors.sum(0))(value) / samples))


def with_error(values: Series, errors: Series) -> tuple[float, float]:
    """Best value for the errors of some switches (one a row) and its bootstrap standard error over them."""
    chance, count = np.random.default_rng(0), len(errors)
    drawn = chance.multinomial(count, np.full(count, 1 / count), size=RESAMPLED) @ errors
    return best(values, errors.sum(0)), float(np.std([best(values, row) for row in drawn]))


def air_line(frequency: NDArray[np.floating], line: Sequence[float]) -> NDArray[np.complex128]:
    """Pressure at the muscle over pressure at the gauge; line: T [s], τ [s], R."""
    (transit, filling, loss), s = line, 2j * np.pi * frequency
    even, odd = np.cosh(s * transit), np.sinh(s * transit)
    return 1 / (even + s * filling * odd + loss * (odd + s * filling * even))


def line_residuals(line: Sequence[float], some: Sequence[Switch]) -> Series:
    """Errors of the force behind an air line at the judged samples of some switches [N]."""
    start = np.array([s.ends[0][0] for s in some])[:, None]
    gauge = np.array([np.interp(GRID, s.time, s.pressure, left=s.ends[0][0]) for s in some]) - start
    # The long rest in front takes up what the periodic transform carries over from the end.
    passed = air_line(np.fft.rfftfreq(len(GRID), 1e-3), line) * np.fft.rfft(gauge)
    muscle = np.fft.irfft(passed, len(GRID)) + start
    return np.concatenate(
        [
            s.static(np.interp(s.time[s.judged], GRID, row)) - s.force[s.judged]
            for s, row in zip(some, muscle, strict=True)
        ]
    )


def fitted_line(some: Sequence[Switch]) -> list[float]:
    starts, most = ((0.008, 0.005, 0.5), (0.001, 0.001, 0.5)), (0.03, 0.08, 20)
    fits = [
        least_squares(
            line_residuals, start, bounds=((1e-5, 0, 0), most), x_scale=(1e-3, 1e-3, 0.1), args=(some,)
        )
        for start in starts
    ]
    return [float(value) for value in min(fits, key=lambda fit: fit.cost).x]


def ringing(some: Sequence[Switch]) -> tuple[float, complex]:
    """Frequency [Hz] of the ringing pressure; the ringing force, as a pressure by the static law, over it."""
    power, cross = np.zeros(len(FREQUENCIES)), np.zeros(len(FREQUENCIES), complex)
    for s in some:
        rows = (s.time > RINGING[0]) & (s.time < RINGING[1])
        at = s.time[rows]
        weights = np.hanning(len(at)) * np.gradient(at)
        wave = np.exp(-2j * np.pi * np.outer(FREQUENCIES, at)) * weights
        pressure, force = (
            wave @ (y - Polynomial.fit(at, y, 2)(at)) for y in (s.pressure[rows], s.force[rows])
        )
        power = power + np.abs(pressure) ** 2
        cross = cross + np.conj(pressure) * force / s.static.deriv()(s.ends[1][0])
    peak = int(np.argmax(power))
    return float(FREQUENCIES[peak]), complex(cross[peak] / power[peak])


def ring_frequency(line: Sequence[float], gauge_end: float) -> float:
    """Lowest resonance [Hz] of a line with the muscle at one end, a closed volume at the other.

    `gauge_end`: filling time of that volume [s]. Lossless.
    """
    transit, filling = line

    def closed(x: float) -> float:
        one, two = x * filling / transit, x * gauge_end / transit
        return float((one + two) * np.cos(x) + (1 - one * two) * np.sin(x))

    return float(brentq(closed, 0.05, np.pi)) / (2 * np.pi * transit)  # type: ignore[arg-type]
