"""Reductions against closed forms and NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from operations import LAPACK, operations

from jaxmuscle.sweeps.reductions import BY_NAME, CATALOGUE
from jaxmuscle.sweeps.scenario import Trajectory

TIME = np.arange(4001) * 0.001
LAG = 0.05


def reduced(name, reading, command=None, frequency=None):
    command = np.zeros_like(TIME) if command is None else command
    number = None if frequency is None else jnp.asarray(frequency)
    run = Trajectory(jnp.asarray(TIME), jnp.asarray(command), {"x": jnp.asarray(reading)}, number)
    return np.asarray(BY_NAME[name].function(run, run.readings["x"]))


RESPONSE = 3.0 * (1 - np.exp(-np.maximum(TIME - 0.5, 0) / LAG))
STEP = np.where(TIME >= 0.5, 2.0, 0.0)


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("maximum", np.max),
        ("minimum", np.min),
        ("span", np.ptp),
        ("mean", np.mean),
        ("rms", lambda x, axis: np.sqrt(np.mean(x**2, axis))),
        ("final", lambda x, axis: x[-1]),
    ],
)
def test_plain_statistics(name, function):
    rng = np.random.default_rng(3)
    for shape in ((4001,), (4001, 2)):
        values = rng.normal(size=shape)
        np.testing.assert_allclose(reduced(name, values), function(values, axis=0), rtol=1e-12)


def test_settling_time_of_a_lag():
    """A first-order lag comes within 2 % after ln 50 time constants."""
    assert reduced("settling_time", RESPONSE) == pytest.approx(0.5 + LAG * np.log(50), abs=0.001)
    assert reduced("settling_time", np.ones_like(TIME)) == 0.0
    both = np.stack([RESPONSE, np.ones_like(TIME)], axis=1)
    np.testing.assert_allclose(reduced("settling_time", both), [0.5 + LAG * np.log(50), 0], atol=0.001)


def test_overshoot_of_a_second_order_system():
    damping, natural = 0.4, 20.0
    damped = natural * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * natural * TIME)
    response = 1 - decay * (np.cos(damped * TIME) + damping * natural / damped * np.sin(damped * TIME))
    exact = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert reduced("overshoot", response) == pytest.approx(exact, rel=1e-3)
    assert reduced("overshoot", -5 * response) == pytest.approx(exact, rel=1e-3)
    assert reduced("overshoot", RESPONSE) == 0.0
    assert np.isnan(reduced("overshoot", np.ones_like(TIME)))


def test_bandwidth_of_a_lag():
    """A first-order lag has fallen by 3 dB at 1/(2π τ)."""
    assert reduced("bandwidth", RESPONSE, STEP) == pytest.approx(1 / (2 * np.pi * LAG), rel=0.01)
    both = np.stack([RESPONSE, 7 * RESPONSE], axis=1)
    np.testing.assert_allclose(reduced("bandwidth", both, STEP), 1 / (2 * np.pi * LAG), rtol=0.01)
    pair = np.stack([STEP, STEP], axis=1)
    np.testing.assert_allclose(reduced("bandwidth", both, pair), 1 / (2 * np.pi * LAG), rtol=0.01)
    assert np.isnan(reduced("bandwidth", STEP, STEP))


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [1.0, 3.3, 40.0])
def test_gain_and_phase_of_a_lag(frequency):
    omega = 2 * np.pi * frequency
    gain, phase = 1.5 / np.hypot(1, omega * LAG), -np.arctan(omega * LAG)
    command = 0.3 + 2.0 * np.sin(omega * TIME)
    reading = 9.0 - 5.0 * TIME + 2.0 * gain * np.sin(omega * TIME + phase)
    assert reduced("gain", reading, command, frequency) == pytest.approx(gain, rel=1e-6)
    assert reduced("phase", reading, command, frequency) == pytest.approx(phase, rel=1e-6)
    both, pair = np.stack([reading, 2 * reading], axis=1), np.stack([command, command], axis=1)
    np.testing.assert_allclose(reduced("gain", both, pair, frequency), [gain, 2 * gain], rtol=1e-6)


def test_no_gain_without_two_periods_or_a_frequency():
    assert np.isnan(reduced("gain", RESPONSE, STEP, 0.4))
    assert np.isnan(reduced("gain", RESPONSE, STEP))
    np.testing.assert_array_equal(reduced("phase", np.stack([STEP, STEP], axis=1), STEP), [np.nan, np.nan])


@pytest.mark.parametrize("reduction", CATALOGUE, ids=lambda reduction: reduction.name)
def test_each_says_what_it_is(reduction):
    assert reduction.meaning and not reduction.meaning.endswith(".")
    assert "{" not in reduction.unit.format(reading="m", command="V")


@pytest.mark.parametrize("reduction", CATALOGUE, ids=lambda each: each.name)
def test_none_calls_lapack(reduction):
    """Batches of a sweep run side by side, and those that call it wait for each other."""

    def reduced_at(hertz):
        run = Trajectory(jnp.asarray(TIME), jnp.sin(hertz * TIME), {"x": jnp.cos(hertz * TIME)}, hertz)
        return reduction.function(run, run.readings["x"])

    found = operations(jax.make_jaxpr(jax.vmap(reduced_at))(jnp.array([1.0, 2.0])).jaxpr)
    assert found and not LAPACK & found
