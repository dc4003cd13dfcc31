"""Autocorrelation of residuals and the tests of them: closed forms, and what scatters over many draws."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from jaxmuscle.estimation.coloured_noise import (
    Autoregression,
    autocovariance,
    burg,
    coloured_meat,
    memory,
    stride,
)
from jaxmuscle.estimation.residual_analysis import Series, independence, residual_tests, whiteness

ROWS = 400
TIME = np.arange(ROWS) / ROWS
SLOPES = np.stack([np.ones(ROWS), np.sin(12 * TIME), TIME, np.sin(40 * TIME)])
EVERY = np.ones(ROWS, bool)
ONE = np.ones(1)


def remembering(rho, seed, rows=ROWS):
    """An autoregression of the first order and variance 1."""
    white = np.random.default_rng(seed).normal(size=rows + 500)
    return np.asarray(lfilter([np.sqrt(1 - rho**2)], [1, -rho], white), dtype=np.float64)[500:]


def counted(kind, seed):
    """Which rows count: all, half of them at random, or every third."""
    if kind == "all":
        return EVERY
    return (
        np.random.default_rng(10_000 + seed).random(ROWS) < 0.5
        if kind == "half"
        else np.arange(ROWS) % 3 == 1
    )


def line(residual, counts=None):
    """A series of residuals that hangs on nothing."""
    counts = np.ones(len(residual), bool) if counts is None else counts
    rows = np.zeros((1, len(counts)))
    return Series(0, "y", "y", counts, np.where(counts, residual, 0.0), rows, np.zeros(len(counts), int))


@pytest.mark.parametrize("reflections", [[], [0.7], [0.95, -0.6], [0.5, 0.3, -0.8]])
def test_covariances_of_an_autoregression(reflections):
    """Against the response to one disturbance; their sum is the autocorrelation time."""
    noise = Autoregression(np.array(reflections), 2.5)
    response = lfilter([1.0], np.append(1.0, -noise.coefficients), np.eye(1, 4000)[0])
    gamma = np.correlate(response, response, "full")[3999:]
    gamma *= 2.5 / gamma[0]
    np.testing.assert_allclose(noise.covariances(50), gamma[:50], rtol=1e-9, atol=1e-9)
    assert noise.time == pytest.approx((2 * gamma.sum() - gamma[0]) / 2.5, rel=1e-9)
    np.testing.assert_array_equal(noise.covariances(2), noise.covariances(50)[:2])


@pytest.mark.parametrize("kind", ["all", "half"])
def test_burg_finds_the_coefficients(kind):
    rows = 40_000
    values = np.asarray(lfilter([1.0], [1, -1.2, 0.5], np.random.default_rng(0).normal(size=rows)))
    counts = np.random.default_rng(1).random(rows) < (0.5 if kind == "half" else 2)
    noise = burg(np.where(counts, values, 0.0)[None], ONE, counts, range(3))
    np.testing.assert_allclose(noise.coefficients, [1.2, -0.5], atol=0.03)
    assert noise.variance == pytest.approx(values[counts].var(), rel=1e-2)


def test_burg_stays_stable_whatever_is_missing():
    """A ramp remembers all; autocovariances divided by pairs would be those of no noise."""
    counts = np.random.default_rng(0).random(ROWS) < 0.4
    noise = burg(np.where(counts, TIME, 0.0)[None], ONE, counts, range(6))
    assert len(noise.reflections) and np.abs(noise.reflections).max() < 1
    assert np.linalg.eigvalsh(toeplitz(noise.covariances(ROWS))).min() > -1e-9


@pytest.mark.parametrize("kind", ["half", "every third"])
def test_autocovariance_is_the_mean_over_pairs(kind):
    counts = counted(kind, 0)
    values = 3.0 + remembering(0.5, 0)
    found = autocovariance(values, counts, 6)
    for lag in range(7):
        both = counts[lag:] & counts[: ROWS - lag]
        mean = (values[lag:] * values[: ROWS - lag])[both].mean() if both.any() else 0.0
        assert found[lag] == pytest.approx(mean, abs=1e-9)


def test_stride():
    assert [stride(counted(kind, 0)) for kind in ("all", "half", "every third")] == [1, 1, 3]
    assert stride(np.arange(9) == 4) == stride(np.zeros(9, bool)) == 1


@pytest.mark.parametrize(
    ("rho", "kind"), [(0.0, "all"), (0.8, "all"), (0.95, "all"), (0.0, "half"), (0.8, "half"), (0.8, "third")]
)
def test_standard_deviations_and_coverage_of_coloured_noise(rho, kind):
    """Four parameters of slow slopes, one series; 95 % intervals of 80 draws."""
    hits, ratios = [], []
    for seed in range(80):
        counts = counted(kind, seed)
        slopes = np.where(counts, SLOPES, 0.0)
        inverse, noise = np.linalg.inv(slopes @ slopes.T), remembering(rho, seed)
        estimate = inverse @ (slopes @ noise)
        found = (
            inverse
            @ coloured_meat(slopes, np.where(counts, noise - estimate @ slopes, 0.0), counts)
            @ inverse
        )
        gamma = rho ** np.arange(ROWS) if rho else np.eye(1, ROWS)[0]
        true = inverse @ (slopes @ toeplitz(gamma) @ slopes.T) @ inverse
        ratios.append(np.sqrt(np.diag(found) / np.diag(true)))
        hits.append(np.abs(estimate) <= 1.96 * np.sqrt(np.diag(found)))
    assert 0.86 <= np.mean(hits) <= 0.98
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.12)


def test_slow_noise_beside_white_noise_is_seen():
    """200 of 2000 readings remembered, as much again of white noise: no autoregression of low order."""
    rows, rho, draws = 2000, np.exp(-1 / 200), 20
    time = np.linspace(-0.5, 0.5, rows)
    slopes = np.stack([np.ones(rows), time])
    inverse = np.linalg.inv(slopes @ slopes.T)
    true = inverse @ (slopes @ toeplitz(np.eye(1, rows)[0] + rho ** np.arange(rows)) @ slopes.T) @ inverse
    ratios = []
    for seed in range(draws):
        values = remembering(rho, seed, rows) + np.random.default_rng(1000 + seed).normal(size=rows)
        values -= inverse @ (slopes @ values) @ slopes
        found = inverse @ coloured_meat(slopes, values, np.ones(rows, bool)) @ inverse
        ratios.append(np.sqrt(np.diag(found) / np.diag(true)))
    assert (np.mean(ratios, axis=0) > 0.6).all()


def test_what_many_series_share_is_given_back_once():
    """Twelve series of one fit: by the inverse of all, little is taken from each."""
    ratios = []
    for seed in range(12):
        noise = np.stack([remembering(0.9, 12 * seed + i) for i in range(12)])
        inverse = np.linalg.inv(12 * SLOPES @ SLOPES.T)
        residual = noise - (inverse @ (SLOPES @ noise.sum(axis=0))) @ SLOPES
        meat = [sum(coloured_meat(SLOPES, e, EVERY, given) for e in residual) for given in (inverse, None)]
        true = 12 * SLOPES @ toeplitz(0.9 ** np.arange(ROWS)) @ SLOPES.T
        ratios.append([np.sqrt(np.diag(m) / np.diag(true)) for m in meat])
    shared, alone = np.mean(ratios, axis=0)
    np.testing.assert_allclose(shared, 1.0, atol=0.06)
    assert (alone > shared).all()


def test_the_score_is_positive_semidefinite_and_zero_without_residuals():
    slopes = np.random.default_rng(1).normal(size=(30, ROWS)) * counted("half", 3)
    found = coloured_meat(slopes, np.where(counted("half", 3), remembering(0.99, 3), 0.0), counted("half", 3))
    assert np.linalg.eigvalsh(found).min() > 0
    np.testing.assert_array_equal(coloured_meat(SLOPES, np.zeros(ROWS), EVERY), np.zeros((4, 4)))


def test_time_allows_for_what_the_fit_took():
    times = []
    for seed in range(50):
        noise = remembering(0.9, seed)
        residual = noise - np.linalg.lstsq(SLOPES.T, noise, rcond=None)[0] @ SLOPES
        times.append([memory(residual, EVERY).time, memory(residual, EVERY, SLOPES).time])
    without, allowing = np.median(times, axis=0)
    assert without < 15 and allowing == pytest.approx(19.0, rel=0.15)


@pytest.mark.parametrize(("missing", "least"), [(0.0, 0.99), (0.3, 0.8), (0.5, 0.35)])
def test_whiteness_with_missing_readings(missing, least):
    """Power at ρ = 0.3, and false alarms at 1 %."""
    found = []
    for seed in range(60):
        counts = np.random.default_rng(seed).random(800) >= missing
        found.append([whiteness(line(remembering(r, seed, 800), counts), "r").passed for r in (0.3, 0.0)])
    power, false = 1 - np.mean(found, axis=0)
    assert power >= least and false <= 0.05


def test_whiteness_of_a_slow_sensor_is_on_its_own_clock():
    found = whiteness(line(remembering(0.9, 0, 1500), np.arange(1500) % 3 == 1), "r")
    assert list(found.lags[:3]) == [3, 6, 9] and not found.passed
    assert found.correlation[0] == pytest.approx(0.9**3, abs=0.1)


def test_too_few_pairs_are_not_tested():
    counts = np.isin(np.arange(100_000), np.random.default_rng(0).choice(100_000, 60, replace=False))
    assert residual_tests([line(np.random.default_rng(1).normal(size=100_000), counts)], ["r"], [{}]) == ()


INPUTS = {
    "slow sine": np.sin(2 * np.pi * 0.23 * 0.01 * np.arange(800)),
    "steps": np.repeat(np.random.default_rng(5).normal(size=16), 50),
    "white": np.random.default_rng(6).normal(size=800),
}


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("missing", [0.0, 0.5])
def test_independence_of_the_input(name, missing):
    """Power at a part of the input in white noise, however large it is; false alarms of coloured noise."""
    given = (INPUTS[name] - INPUTS[name].mean()) / INPUTS[name].std()
    found = []
    for seed in range(15):
        counts = np.random.default_rng(seed).random(800) >= missing
        white, slow = np.random.default_rng(100 + seed).normal(size=800), remembering(0.95, seed, 800)
        each = [0.4 * given + white, 100 * given + white, slow]
        found.append([independence(line(e, counts), "r", "u", given).passed for e in each])
    assert np.mean(found, axis=0)[:2].max() <= 0.05 and np.mean(found, axis=0)[2] >= 0.92


def test_correlation_with_an_input_that_leads():
    given = np.random.default_rng(2).normal(size=3000)
    test = independence(line(np.roll(given, 7)), "r", "u", given)
    assert test.lags[np.argmax(np.abs(test.correlation))] == 7
    assert test.correlation.max() == pytest.approx(1.0, abs=0.01)
