"""Likelihood ratio of a candidate: uniform under the null, whatever the size and the memory of the noise."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kstest

from jaxmuscle.diagnosis.likelihood_ratio import likelihood_ratio_test, more_likely

WINDOWS, SAMPLES = 12, 250


def fitted(values, basis):
    """What least squares with the rows of `basis` leave of `values`."""
    turned, _ = np.linalg.qr(basis.T)
    return values - turned @ (turned.T @ values)


def shaped(values):
    return {"angle": values.reshape(WINDOWS, SAMPLES)}


def p_value(rng, correlation, size, strength=0.0):
    """Of two further parameters of a linear model, beside one it has anyway."""
    time = np.linspace(0, 20, WINDOWS * SAMPLES)
    own, more = np.ones((1, len(time))), np.stack([np.sin(time), np.sin(2.3 * time)])
    white = np.sqrt(1 - correlation**2) * rng.normal(size=len(time))
    values = size * np.asarray(lfilter([1.0], [1.0, -correlation], white)) + strength * more[0]
    before, after = fitted(values, own), fitted(values, np.concatenate([own, more]))
    weights = shaped(np.ones(len(time)))
    return likelihood_ratio_test(shaped(before), shaped(after), weights, 2)


@pytest.mark.parametrize(("correlation", "size"), [(0.0, 1.0), (0.0, 3.0), (0.8, 1.0), (0.9, 2.0)])
def test_uniform_where_the_parameters_are_not_there(correlation, size):
    rng = np.random.default_rng(1)
    found = np.array([p_value(rng, correlation, size) for _ in range(200)])
    assert kstest(found, "uniform").pvalue > 1e-3
    assert np.mean(found < 0.01) <= 0.03


def test_noise_smaller_than_the_sensors_is_not_believed():
    found = [p_value(np.random.default_rng(seed), 0.0, 0.3) for seed in range(50)]
    assert min(found) > 0.2


def test_what_is_there_is_seen():
    assert p_value(np.random.default_rng(2), 0.0, 1.0, strength=0.3) < 1e-10


def test_rows_that_do_not_count_and_columns_without_any():
    rng = np.random.default_rng(3)
    before, after = rng.normal(size=(2, WINDOWS, SAMPLES, 2))
    weights = np.ones_like(before)
    weights[:, 100:, 0], weights[..., 1] = 0.0, 0.0
    spoilt = before.copy()
    spoilt[:, 100:, 0], spoilt[..., 1] = 1e6, np.nan
    given = [likelihood_ratio_test({"p": b}, {"p": after}, {"p": weights}, 1) for b in (before, spoilt)]
    assert given[0] == given[1]


def test_a_larger_model_that_fits_worse_shows_nothing():
    zero, one = shaped(np.zeros(WINDOWS * SAMPLES)), shaped(np.ones(WINDOWS * SAMPLES))
    assert likelihood_ratio_test(zero, one, one, 1) == 1.0


def odds(rng, true, correlation=0.0):
    """Of a cosine for a sine of the same frequency, where the first or the second is there."""
    time = np.linspace(0, 20, WINDOWS * SAMPLES)
    both = np.sin(2 * time), np.cos(2 * time)
    white = np.sqrt(1 - correlation**2) * rng.normal(size=len(time))
    values = 0.3 * both[true] + np.asarray(lfilter([1.0], [1.0, -correlation], white))
    one, other = (shaped(fitted(values, each[None])) for each in both)
    return more_likely(one, other, shaped(np.ones(len(time))), 0)


def test_the_true_one_of_two_models_is_the_likelier_one():
    for true, sign in ((0, -1), (1, 1)):
        rng = np.random.default_rng(4)
        assert min(sign * odds(rng, true) for _ in range(20)) > 10
        assert min(sign * odds(rng, true, correlation=0.9) for _ in range(20)) > -6


def test_parameters_more_have_to_be_worth_it():
    """Readings of a column in which the models are the same say nothing of their parameters."""
    count, rng = WINDOWS * SAMPLES, np.random.default_rng(6)
    one, other, same = (shaped(rng.normal(size=count)) for _ in range(3))
    there = shaped(np.ones(count))
    few, more = (more_likely(one, other, there, parameters) for parameters in (0, 2))
    assert few - more == pytest.approx(2 * np.log(count), rel=0.05)
    beside = [each | {"pressure": same["angle"]} for each in (one, other, there)]
    assert more_likely(beside[0], beside[1], beside[2], 2) == pytest.approx(more, rel=1e-9)


def test_of_two_models_that_predict_the_same_the_one_with_fewer_parameters_is_the_likelier_one():
    count, rng = WINDOWS * SAMPLES, np.random.default_rng(6)
    one, there = shaped(rng.normal(size=count)), shaped(np.ones(count))
    assert more_likely(one, one, there, 0) == 0.0
    assert more_likely(one, one, there, -1) == pytest.approx(np.log(count), rel=0.05)
    assert more_likely(one, one, there, 1) == -more_likely(one, one, there, -1)
