"""Smoothing against signals whose noise, value and rate are known."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from jaxmuscle.recordings.smoothing import (
    ORDER,
    WINDOWS,
    noise_level,
    quantisation_step,
    rate_from_past,
    smooth,
)

STEP = 0.01
TIME = np.arange(3000) * STEP
OMEGA = 2 * np.pi * 0.2
SINE = np.sin(OMEGA * TIME)
SLOPE = OMEGA * np.cos(OMEGA * TIME)
NOISE = 0.02
WHITE = NOISE * np.random.default_rng(7).normal(size=len(TIME))
NOISY = SINE + WHITE
INNER = slice(WINDOWS[-1], -WINDOWS[-1])


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("level", [1e-3, 0.02, 0.3])
def test_noise_level_of_white_noise(level):
    noise = level * np.random.default_rng(3).normal(size=len(TIME))
    assert noise_level(SINE + noise) == pytest.approx(level, rel=0.1)


def test_noise_level_is_deaf_to_steps():
    steps = np.floor(TIME / 1.7)
    noise = 0.02 * np.random.default_rng(3).normal(size=len(TIME))
    assert noise_level(steps + noise) == pytest.approx(0.02, rel=0.1)
    assert noise_level(steps) == 0.0


STEPPED = 3.3 + 100 * np.sin(0.5 * OMEGA * TIME)
"""In units of a converter's step: at most one step from one sample to the next."""


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("step", [1.0, 5 / 4096])
def test_noise_level_of_a_quantised_signal(noise, step):
    """Within a factor of two of what the readings are really off by; 0 without the step's own part."""
    true = STEPPED + noise * np.random.default_rng(3).normal(size=len(TIME))
    read = step * np.round(true)
    assert quantisation_step(read) == pytest.approx(step)
    off = rms(read - step * STEPPED)
    assert off / 2 < noise_level(read) < 2 * off
    assert noise_level(read) >= 0.999 * step / np.sqrt(12)


def test_quantised_and_rounded_again_when_it_was_written():
    step = 5 / 4096
    read = np.round(step * np.round(STEPPED), 4)
    assert quantisation_step(read) == pytest.approx(step, rel=0.1)
    assert 0.9 * step / np.sqrt(12) < noise_level(read) < 2 * step / np.sqrt(12)


@pytest.mark.parametrize("digits", [4, 6])
def test_digits_far_below_the_noise_change_nothing(digits):
    printed = np.array([float(f"{value:.{digits}g}") for value in NOISY])
    fourth = np.diff(printed, n=4)
    plain = 1.4826 * np.median(np.abs(fourth - np.median(fourth))) / np.sqrt(70.0)
    assert noise_level(printed) == plain == pytest.approx(NOISE, rel=0.1)


NEVER_READ_IN_STEPS = {
    "noise": NOISY,
    "sine of whole samples a period": np.sin(2 * np.pi * np.arange(len(TIME)) / 500),
    "ramp": 0.37 * TIME,
    "triangle": np.abs((0.5 * TIME) % 2 - 1),
    "trapezium": np.clip(2 * np.abs((0.5 * TIME) % 2 - 1) - 0.5, 0, 1),
    "on a plate": np.maximum(np.sin(OMEGA * TIME), 0),
    "held at random": np.repeat(np.random.default_rng(1).normal(size=60), 50),
    "staircase": np.floor(TIME / 1.7),
}


@pytest.mark.parametrize("name", NEVER_READ_IN_STEPS)
def test_signals_without_a_converter_have_no_step(name):
    assert quantisation_step(NEVER_READ_IN_STEPS[name]) == 0.0


def test_smooth_is_nearer_to_a_sine_than_the_samples():
    smoothed, _ = smooth(NOISY, STEP, NOISE)
    assert rms(WHITE) > 5.0 * rms(smoothed - SINE)


@pytest.mark.parametrize("frequency", [0.4, 0.8, 1.6])
def test_window_narrows_with_the_curvature(frequency):
    """The widest window alone would be off by far more than the samples; what is chosen never is."""
    sine = np.sin(2 * np.pi * frequency * TIME)
    smoothed, _ = smooth(sine + WHITE, STEP, NOISE)
    assert rms(WHITE) > rms(smoothed - sine)
    widest = savgol_filter(sine, WINDOWS[-1], ORDER)
    assert rms(widest - sine) > 2 * rms(smoothed - sine)


def test_peaks_are_not_cut():
    """Smoothed once, the amplitude comes out 1.7 % too small, in every draw."""
    fast, cut = np.sin(2 * np.pi * 0.8 * TIME), []
    for seed in range(40):
        noise = NOISE * np.random.default_rng(seed).normal(size=len(TIME))
        cut.append((smooth(fast + noise, STEP, NOISE, twice=True)[0] - fast) @ fast / (fast @ fast))
    assert abs(np.mean(cut)) < 1.5e-3


def test_smooth_slope():
    slope, _ = smooth(NOISY, STEP, NOISE, derivative=1)
    assert rms(slope[INNER] - SLOPE[INNER]) < 0.05 * rms(SLOPE)
    assert rms(np.gradient(NOISY, STEP) - SLOPE) > 0.5 * rms(SLOPE)


@pytest.mark.parametrize(("derivative", "twice"), [(0, False), (0, True), (1, False)])
def test_deviation_is_that_of_the_error(derivative, twice):
    truth = (SINE, SLOPE)[derivative]
    smoothed, deviation = smooth(NOISY, STEP, NOISE, derivative, twice)
    assert 0.5 < rms(((smoothed - truth) / deviation)[INNER]) < 2.0


def test_cubic_without_noise_is_left_as_it_is():
    cubic = 3 - 2 * TIME + 0.1 * TIME**2 - 0.004 * TIME**3
    smoothed, deviation = smooth(cubic, STEP, 1e-9)
    np.testing.assert_allclose(smoothed, cubic, rtol=0, atol=1e-9)
    assert deviation.max() < 1e-9
    slope, _ = smooth(cubic, STEP, 1e-9, derivative=1)
    np.testing.assert_allclose(slope, -2 + 0.2 * TIME - 0.012 * TIME**2, rtol=0, atol=1e-7)


def test_follows_a_step_within_the_narrowest_window():
    step = np.where(np.arange(len(TIME)) < 1500, 0.0, 1.0)
    smoothed, _ = smooth(step + NOISE * np.random.default_rng(5).normal(size=len(TIME)), STEP, NOISE)
    half = WINDOWS[0] // 2
    away = np.abs(np.arange(len(TIME)) - 1499.5) > half
    assert np.abs(smoothed - step)[away].max() < 4 * NOISE
    widest = np.convolve(step, np.ones(WINDOWS[-1]) / WINDOWS[-1], "same")
    assert np.abs(widest - step)[away][200:-200].max() > 0.4


@pytest.mark.parametrize("samples", [1, 2, 6])
def test_few_samples_are_left_as_they_are(samples):
    values = np.array([0.3, 1.1, 0.2, 0.4, 2.0, 1.0])[:samples]
    same, deviation = smooth(values, STEP, NOISE)
    np.testing.assert_array_equal(same, values)
    np.testing.assert_array_equal(deviation, np.full(samples, NOISE))


def test_slope_of_few_samples_is_their_difference():
    slope, deviation = smooth(np.array([0.0, 0.1, 0.4, 0.9]), STEP, NOISE, derivative=1)
    np.testing.assert_allclose(slope, [10.0, 20.0, 40.0, 50.0], rtol=1e-12)
    assert deviation[0] == pytest.approx(np.sqrt(2) * NOISE / STEP)
    alone, _ = smooth(np.array([0.7]), STEP, NOISE, derivative=1)
    np.testing.assert_array_equal(alone, [0.0])


def test_rate_from_past_does_not_know_what_comes():
    now = 1700
    other = np.where(np.arange(len(NOISY)) <= now, NOISY, 0.0)
    for first, second in zip(
        rate_from_past(NOISY, STEP, NOISE), rate_from_past(other, STEP, NOISE), strict=True
    ):
        np.testing.assert_array_equal(first[: now + 1], second[: now + 1])


def test_rate_from_past_of_a_parabola():
    rate, spread = rate_from_past(2.0 - 3.0 * TIME + 4.0 * TIME**2, STEP, 0.0)
    np.testing.assert_allclose(rate[3:], -3.0 + 8.0 * TIME[3:], rtol=0, atol=1e-8)
    np.testing.assert_array_equal(spread, 0.0)


def test_rate_from_past_knows_its_noise():
    """Of a ramp, which every window fits: the error is as large as is told, far below a difference's."""
    rate, spread = rate_from_past(0.5 * TIME + WHITE, STEP, NOISE)
    off = (rate - 0.5)[100:] / spread[100:]
    assert 0.7 < rms(off) < 1.6
    assert rms(rate[100:] - 0.5) < 0.2 * NOISE * np.sqrt(2.0) / STEP


def test_rate_from_past_of_a_sine():
    """Several times the error of a rate that knows both sides, and well below a difference's."""
    past = rms((rate_from_past(NOISY, STEP, NOISE)[0] - SLOPE)[INNER])
    both = rms((smooth(NOISY, STEP, NOISE, 1)[0] - SLOPE)[INNER])
    assert 2 * both < past < 0.2 * NOISE * np.sqrt(2.0) / STEP


@pytest.mark.parametrize("count", [1, 2, 3])
def test_rate_from_past_of_a_few_samples(count):
    rate, spread = rate_from_past(0.5 * TIME[:count].astype(np.float64), STEP, NOISE)
    np.testing.assert_allclose(rate, 0.5 if count > 1 else 0.0, rtol=1e-12)
    assert (spread > 0).all() and np.isfinite(spread).all()
