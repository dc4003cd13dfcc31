"""Delay of the command and lag of the force sensor."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.effects import CommandDelay, ForceSensorLag
from jaxmuscle.signals import Past, Signals

STEP = 2e-3
BEFORE = 0.7
"""The command of a machine at rest before the first sample."""
COMMAND = np.random.default_rng(5).uniform(-5, 5, 40)


def delayed(delay, row):
    past = Past(jnp.asarray(COMMAND), jnp.asarray(row), jnp.asarray(STEP), jnp.asarray(BEFORE))
    effect = built(CommandDelay, delay=delay)
    return float(COMMAND[row] + effect.value(Signals(command=jnp.asarray(COMMAND[row]), past=past)))


@pytest.mark.parametrize("samples", [0, 1, 5, 12])
def test_whole_samples_shift_the_command(samples):
    for row in (0, 3, 12, 39):
        expected = COMMAND[row - samples] if row >= samples else BEFORE
        assert delayed(samples * STEP, row) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("part", [0.25, 0.5, 0.9])
def test_fractions_take_the_mean_over_the_interval(part):
    # Of the interval after row 20, the first part still sees the command of row 17, the rest that of 18.
    expected = part * COMMAND[17] + (1 - part) * COMMAND[18]
    assert delayed((2 + part) * STEP, 20) == pytest.approx(expected, rel=1e-9)


def test_run_under_a_whole_delay_is_the_run_of_the_shifted_command():
    samples = 12
    command = bench.isotonic_command()[:300]
    shifted = np.concatenate([np.zeros(samples), command[:-samples]])
    late = bench.simulated(
        bench.model("isotonic", command_delay={"delay": samples * STEP}), bench.isotonic_track(command), 2
    )
    moved = bench.simulated(
        bench.model("isotonic", command_delay={"delay": 0.0}), bench.isotonic_track(shifted), 2
    )
    for name, reading in late.readings.items():
        np.testing.assert_allclose(reading, moved.readings[name], rtol=1e-10, atol=1e-12)
    assert float(np.ptp(late.readings["position"])) > 0.03


def test_slope_at_zero_delay_is_that_of_the_mean():
    past = Past(jnp.asarray(COMMAND), jnp.asarray(20), jnp.asarray(STEP), jnp.asarray(BEFORE))
    slope = jax.grad(lambda d: built(CommandDelay, delay=d).value(Signals(past=past)))(jnp.asarray(0.0))
    assert float(slope) == pytest.approx((COMMAND[19] - COMMAND[20]) / STEP, rel=1e-12)


@jax.jit
def shown(time_constant, step, force):
    """Reading of a lagging sensor for a force sampled at a constant step, at rest at first."""
    lag = built(ForceSensorLag, time_constant=time_constant)

    def onward(memory, value):
        signals = Signals(force=value)
        memory = lag.update(memory, signals, step)
        return memory, value + lag.value(memory, signals)

    return jax.lax.scan(onward, lag.initial(Signals(force=force[0])), force)[1]


@pytest.mark.parametrize("time_constant", [1e-4, 0.01, 3.0])
@pytest.mark.parametrize("step", [2e-3, 0.1])
def test_ramp_is_exact_at_any_step(step, time_constant):
    time, rate = np.arange(50) * step, 37.0
    expected = 5.0 + rate * (time - time_constant * (1 - np.exp(-time / time_constant)))
    reading = shown(jnp.asarray(time_constant), jnp.asarray(step), jnp.asarray(5.0 + rate * time))
    np.testing.assert_allclose(reading, expected, rtol=1e-9)


def test_exponential_approach_is_of_second_order():
    def error(step):
        time, slow, tau = np.arange(round(1 / step) + 1) * step, 0.3, 0.05
        expected = 1 - (slow * np.exp(-time / slow) - tau * np.exp(-time / tau)) / (slow - tau)
        reading = shown(jnp.asarray(tau), jnp.asarray(step), jnp.asarray(1 - np.exp(-time / slow)))
        return np.abs(reading - expected).max()

    # A chord misses the force by at most F'' h² / 8.
    assert error(2e-3) < 2e-3**2 / 8 / 0.3**2
    assert error(4e-3) / error(2e-3) == pytest.approx(4, abs=0.1)


def test_zero_time_constant_shows_the_force_itself():
    force = jnp.asarray(np.random.default_rng(1).normal(300, 50, 30))
    np.testing.assert_array_equal(shown(jnp.asarray(0.0), jnp.asarray(0.01), force), force)


def test_slope_at_zero_time_constant_is_the_rate_of_the_force():
    force = jnp.asarray(np.random.default_rng(1).normal(300, 50, 30))
    slope = jax.jacfwd(shown)(jnp.asarray(0.0), jnp.asarray(0.01), force)
    np.testing.assert_allclose(slope[1:], -np.diff(force) / 0.01, rtol=1e-12)
