"""Standard deviations against what scatters, in a linear model with white, coloured and clustered noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmuscle.estimation.coloured_noise import autocovariance, coloured_meat, memory
from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.free_parameters import Prior, Unknown, Unknowns
from jaxmuscle.estimation.losses import LOSSES, Squares, Student
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.parameters import Parameter

ROWS, WINDOWS = 1200, 24
TIME = np.arange(ROWS) / ROWS
SLOPES = np.stack([np.ones(ROWS), np.sin(12 * TIME), TIME])
EVERY = np.ones(ROWS, bool)
FREE = np.zeros(3, bool)


def filtered(above, below, series):
    """The output of a linear filter."""
    return np.asarray(lfilter(above, below, series), dtype=np.float64)


def unknowns(prior=None, count=3):
    """`count` entries on one recording, unbounded, of scale 1."""
    place = [Parameter(path=f"p{i}", value=0.0) for i in range(count)]
    return Unknowns([Unknown(p.name, p, (0,), 0.0, -np.inf, np.inf, 1.0, prior) for p in place])


def noise(kind, rng):
    """White; an autoregression of time constant 19 samples' worth; or alike within a window."""
    white = rng.normal(size=ROWS)
    if kind == "coloured":
        return filtered([np.sqrt(1 - 0.9**2)], [1, -0.9], rng.normal(size=ROWS + 300))[300:]
    if kind == "windows":
        return np.repeat(rng.normal(size=WINDOWS), ROWS // WINDOWS) + 0.3 * white
    return white


def estimated(kind, seed, loss=LOSSES["squares"]):
    """Least-squares estimate (the truth is zero) and its covariance."""
    e = noise(kind, np.random.default_rng(seed))
    estimate = np.linalg.lstsq(SLOPES.T, e, rcond=None)[0]
    line = Series(0, "y", "y", EVERY, SLOPES.T @ estimate - e, SLOPES, np.arange(ROWS) // (ROWS // WINDOWS))
    return estimate, covariance([line], unknowns(), loss, FREE)


@pytest.mark.parametrize(
    ("kind", "rule", "least", "most"),
    [
        ("white", "independent", 0.91, 0.98),
        ("white", "std", 0.93, 1.0),
        ("coloured", "coloured", 0.85, 0.98),
        ("coloured", "independent", 0.2, 0.55),
        ("coloured", "std", 0.88, 0.99),
        ("windows", "windows", 0.85, 0.99),
        ("windows", "independent", 0.2, 0.55),
    ],
)
def test_coverage(kind, rule, least, most):
    """Of 95 % intervals, over 100 draws of three parameters."""
    hits = []
    for seed in range(100):
        estimate, found = estimated(kind, seed)
        hits.append(np.abs(estimate) <= 1.96 * getattr(found, rule))
    assert least <= np.mean(hits) <= most


def test_white_noise_of_the_assumed_size_is_the_inverse_information():
    _, found = estimated("white", 3)
    np.testing.assert_allclose(found.assumed, np.sqrt(np.diag(np.linalg.inv(SLOPES @ SLOPES.T))), rtol=1e-9)
    np.testing.assert_allclose(found.independent, found.assumed, rtol=0.05)


def test_student_is_little_worse_on_normal_noise():
    plain, robust = (estimated("white", 5, loss)[1] for loss in (Squares(), Student()))
    np.testing.assert_allclose(robust.independent / plain.independent, 1.05, atol=0.06)


def test_a_prior_counts_once():
    """Without data the standard deviation is the prior's."""
    empty = Series(0, "y", "y", np.zeros(ROWS, bool), np.zeros(ROWS), np.zeros((3, ROWS)), np.full(ROWS, -1))
    found = covariance([empty], unknowns(Prior(0.0, 0.3)), Squares(), FREE)
    np.testing.assert_allclose(found.std, 0.3)


def test_at_a_bound_there_is_no_deviation_and_the_others_know_more():
    rng = np.random.default_rng(0)
    line = Series(0, "y", "y", EVERY, rng.normal(size=ROWS), SLOPES, np.arange(ROWS) // 50)
    whole = covariance([line], unknowns(), Squares(), FREE)
    held = covariance([line], unknowns(), Squares(), np.array([False, False, True]))
    assert held.std[2] == 0 and (held.independent[:2] < whole.independent[:2]).all()


def test_what_is_not_determined_has_no_deviation():
    """The first two always come as their sum, the third is seen, the fourth never."""
    rng = np.random.default_rng(0)
    slopes = np.stack([SLOPES[1], SLOPES[1], SLOPES[2], 0 * TIME])
    line = Series(0, "y", "y", EVERY, rng.normal(size=ROWS), slopes, np.arange(ROWS) // 50)
    found = covariance([line], unknowns(count=4), Squares(), np.zeros(4, bool))
    np.testing.assert_array_equal(np.isinf(found.std), [True, True, False, True])
    assert found.correlations[0, 1] == pytest.approx(-1.0)
    assert found.correlations[0, 2] == 0 and found.correlations[3, 0] == pytest.approx(0.0, abs=1e-9)


def test_autocorrelation_time():
    """Of an autoregression with coefficient a: (1 + a)/(1 - a)."""
    series = filtered([1.0], [1, -0.8], np.random.default_rng(2).normal(size=60_000))
    assert memory(series, np.ones(60_000, bool)).time == pytest.approx(9.0, rel=0.15)
    white = np.random.default_rng(2).normal(size=60_000)
    assert memory(white, np.ones(60_000, bool)).time == pytest.approx(1.0, abs=0.1)
    assert memory(np.zeros(10), np.ones(10, bool)).time == 1.0


def test_coloured_score_against_the_sum_written_out():
    rng = np.random.default_rng(4)
    values, slopes = filtered([1.0], [1, -0.6], rng.normal(size=90)), rng.normal(size=(2, 90))
    every = np.ones(90, bool)
    gamma = memory(values, every, slopes).noise.covariances(90)
    assert gamma[1] > 0.3 * gamma[0]
    expected = np.zeros((2, 2))
    for t in range(90):
        for s in range(90):
            expected += np.outer(slopes[:, t], slopes[:, s]) * gamma[abs(t - s)]
    np.testing.assert_allclose(coloured_meat(slopes, values, every), expected, rtol=1e-9)


def test_gaps_do_not_count():
    rng = np.random.default_rng(4)
    values, counts = rng.normal(size=400) + 5.0, rng.random(400) < 0.5
    assert autocovariance(values, counts, 3)[0] == pytest.approx((values[counts] ** 2).mean())


def test_a_single_window_is_taken_in_parts():
    """Errors that go together where slopes are large: neither white nor stationary noise shows them."""
    rng, held = np.random.default_rng(3), []
    rows, burst = 600, np.zeros(600)
    burst[::60] = 1.0
    shape = np.convolve(burst, np.ones(15))[:rows]
    for _ in range(150):
        jumps = np.repeat(rng.normal(size=10), 60)
        residual = 0.3 * rng.normal(size=rows) + 2.0 * jumps * (shape > 0)
        slopes = shape[None]
        off = residual @ shape / (shape @ shape)
        line = Series(0, "y", "y", np.ones(rows, bool), residual - off * shape, slopes, np.zeros(rows, int))
        found = covariance([line], unknowns(count=1), Squares(), np.zeros(1, bool))
        held.append([abs(off) < 1.96 * std[0] for std in (found.windows, found.independent)])
    parts, independent = np.mean(held, axis=0)
    assert parts > 0.85 and independent < 0.6
