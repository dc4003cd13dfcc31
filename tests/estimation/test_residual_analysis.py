"""Tests of residuals: white ones pass as often as they should, those that follow the input do not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmuscle.estimation.residual_analysis import Series, independence, whiteness


def line(residual, counts=None):
    """A line of residuals."""
    counts = np.ones(len(residual), bool) if counts is None else counts
    kept = np.where(counts, residual, 0.0)
    return Series(0, "y", "y", counts, kept, np.zeros((1, len(residual))), np.zeros(len(residual), int))


def test_white_residuals_pass_as_often_as_they_should():
    rng = np.random.default_rng(1)
    passed = [whiteness(line(rng.normal(size=800)), "r").passed for _ in range(200)]
    assert 0.96 <= np.mean(passed) <= 1.0
    outside = [whiteness(line(rng.normal(size=800)), "r").outside for _ in range(50)]
    assert np.mean(outside) < 0.025


def test_coloured_residuals_do_not():
    series = lfilter([1.0], [1, -0.3], np.random.default_rng(1).normal(size=800))
    found = whiteness(line(series), "r")
    assert not found.passed and abs(found.correlation[0]) > found.band[0]


def test_residuals_that_follow_the_input():
    rng = np.random.default_rng(1)
    given = np.repeat(rng.normal(size=100), 10)
    residual = np.roll(given, 4) + rng.normal(size=1000)
    found = independence(line(residual), "r", "command", given)
    assert not found.passed
    assert found.lags[np.argmax(found.correlation)] == 4


@pytest.mark.slow
def test_independent_residuals_pass_white_or_not():
    rng = np.random.default_rng(1)
    passed = []
    for _ in range(150):
        given = np.repeat(rng.normal(size=100), 10)
        residual = lfilter([1.0], [1, -0.8], rng.normal(size=1000))
        passed.append(independence(line(residual), "r", "command", given).passed)
    assert np.mean(passed) >= 0.95
