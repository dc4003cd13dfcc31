"""Steps within a radius against a plain search for the damping, and the fall of a quadratic model."""

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxmuscle.estimation.quadratic import NEAR, Quadratic

RNG = np.random.default_rng(0)
SLOPES = RNG.normal(size=(40, 5)) * np.array([1.0, 1e3, 1e-2, 5.0, 1e-4])
H, G = SLOPES.T @ SLOPES, SLOPES.T @ RNG.normal(size=40)
UNIT = np.sqrt(np.diag(H))


def test_the_fall_is_that_of_the_whole_step():
    whole = -np.linalg.solve(H, G)
    model = Quadratic(H, G, UNIT)
    assert model.fall == pytest.approx(-(G @ whole + 0.5 * whole @ H @ whole), rel=1e-9)
    np.testing.assert_allclose(model.within(1e9), whole, rtol=1e-8)


def test_a_damped_step_is_marquardts():
    expected = -np.linalg.solve(H + 0.3 * np.diag(UNIT**2), G)
    np.testing.assert_allclose(Quadratic(H, G, UNIT).damped(0.3), expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.9, 0.1, 1e-3])
def test_within_a_radius_it_is_the_damped_step_of_that_length(share):
    def size(damping):
        return np.linalg.norm(UNIT * np.linalg.solve(H + damping * np.diag(UNIT**2), G))

    radius = share * size(0.0)
    damping = float(brentq(lambda x: size(x) - radius, 0.0, 1e6))  # pyright: ignore
    expected = -np.linalg.solve(H + damping * np.diag(UNIT**2), G)
    step = Quadratic(H, G, UNIT).within(radius)
    assert np.linalg.norm(UNIT * step) <= radius * (1 + 1e-12)
    np.testing.assert_allclose(UNIT * step, UNIT * expected, atol=2 * NEAR * radius)


def test_a_direction_without_curvature_does_not_make_a_step_infinite():
    flat = np.outer([1.0, 1.0], [1.0, 1.0])
    step = Quadratic(flat, np.array([1.0, 1.0]), np.ones(2)).within(10.0)
    assert np.isfinite(step).all() and step == pytest.approx([-0.5, -0.5])
