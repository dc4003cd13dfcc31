"""Coordinates of the unknowns there and back, and where starts lie."""

import numpy as np
import pytest
from scipy.stats import norm, qmc

from jaxmuscle.estimation.free_parameters import Prior, Unknown, Unknowns
from jaxmuscle.estimation.starting_points import spread_starts
from jaxmuscle.parameters import Parameter


def two(prior, **more):
    """A positive entry and one that may be negative."""
    area = Parameter(path="area", value=2e-6, unit="m^2", positive=True)
    shift = Parameter(path="shift", value=0.0, unit="m")
    high = more.get("upper", np.inf)
    return Unknowns(
        [
            Unknown("area", area, (0,), 2e-6, 0.0, high, prior.std if prior else 1e-6, prior),
            Unknown("shift", shift, (0, 1), 0.0, -np.inf, np.inf, 1e-3),
        ]
    )


def test_coordinates_there_and_back():
    vector = two(Prior(1.8e-6, 3e-7))
    values = np.array([[1e-6, -2e-3], [5e-6, 4e-3]])
    np.testing.assert_allclose(vector.values(vector.coordinates(values)), values, rtol=1e-12)
    u, h = vector.coordinates(values[0]), 1e-6
    for i in range(2):
        step = h * np.eye(2)[i]
        slope = (vector.values(u + step) - vector.values(u - step))[i] / (2 * h)
        assert vector.slopes(u)[i] == pytest.approx(slope, rel=1e-6)
        prior = (vector.prior_residuals(u + step) - vector.prior_residuals(u - step))[i] / (2 * h)
        assert vector.prior_slopes[i] == pytest.approx(prior, rel=1e-6, abs=1e-9)
    assert vector.prior_residuals(vector.coordinates(np.array([1.8e-6, 1.0])))[0] == pytest.approx(
        0, abs=1e-9
    )
    np.testing.assert_array_equal(vector.acting_on(1), [1])


def test_starts_fill_the_prior_evenly():
    """One start in each of ten equal shares of the prior: that is what a Latin hypercube is."""
    vector = two(Prior(2e-6, 4e-7))
    points = spread_starts(vector, 11, seed=0)
    np.testing.assert_allclose(vector.values(points[0]), [2e-6, 0.0])
    deviations = np.stack([(points[1:, 0] - np.log(2e-6)) / 0.2, points[1:, 1]])
    edges = np.array([-1.2816, -0.8416, -0.5244, -0.2533, 0.0, 0.2533, 0.5244, 0.8416, 1.2816])
    for each in deviations:
        np.testing.assert_array_equal(np.searchsorted(edges, np.sort(each)), np.arange(10))
    np.testing.assert_array_equal(points, spread_starts(vector, 11, seed=0))
    assert not np.array_equal(points, spread_starts(vector, 11, seed=1))


def test_starts_are_those_of_scipy():
    """Seeded as NumPy's own generator, which gives the same numbers in every version of SciPy."""
    generator = np.random.default_rng(5)
    shares = qmc.LatinHypercube(2, seed=generator).random(6)  # pyright: ignore[reportCallIssue]
    points = spread_starts(two(Prior(2e-6, 4e-7)), 7, seed=5)[1:]
    expected = norm.ppf(shares) * [0.2, 1.0] + [np.log(2e-6), 0.0]
    np.testing.assert_allclose(points, expected, rtol=1e-12, atol=1e-12)


def test_starts_about_a_prior_of_mean_zero():
    place = Parameter(path="shift", value=0.0, unit="m")
    vector = Unknowns([Unknown("shift", place, (0,), 0.0, -np.inf, np.inf, 2e-3, Prior(0.0, 2e-3))])
    values = vector.values(spread_starts(vector, 101, seed=0))[1:, 0]
    assert values.mean() == pytest.approx(0.0, abs=2e-4) and values.std() == pytest.approx(2e-3, rel=0.1)


def test_starts_keep_within_bounds():
    vector = two(Prior(2e-6, 2e-6), upper=2.5e-6)
    values = vector.values(spread_starts(vector, 40, seed=0))[:, 0]
    assert values.max() < 2.5e-6 and (values > 2.4e-6).sum() > 3
