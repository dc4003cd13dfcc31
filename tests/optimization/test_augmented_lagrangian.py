"""Least squares under inequalities: minima known by hand, another optimiser, what is told."""

import numpy as np
import pytest
from scipy.optimize import minimize

from jaxmuscle.errors import InputError
from jaxmuscle.optimization.augmented_lagrangian import Bounded, constrained_least_squares


def line(x):
    """Distance from (2, 1), on or below x + y = 1, with x at most 5."""
    return Bounded(
        x - [2.0, 1.0], np.eye(2), np.array([x.sum() - 1.0, x[0] - 5.0]), np.array([[1.0, 1], [1, 0]])
    )


def test_the_foot_on_a_line_with_its_multiplier():
    found = constrained_least_squares(line, np.zeros(2), tolerance=1e-9)
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-8)
    # The gradient x - (2, 1) = -λ (1, 1); the limit of x is not reached.
    np.testing.assert_allclose(found.multipliers, [1.0, 0.0], atol=1e-5)
    assert found.kept and found.converged and found.cost == pytest.approx(1.0)


def test_a_limit_that_is_not_reached_changes_nothing():
    found = constrained_least_squares(lambda x: line(x)._replace(excess=line(x).excess - 9.0), np.zeros(2))
    np.testing.assert_allclose(found.x, [2.0, 1.0], atol=1e-7)
    assert found.rounds == 1 and not found.multipliers.any()


def test_an_equality_is_two_inequalities():
    """The point of the circle of radius 1 that is nearest to (3, 4)."""

    def circle(x):
        over, slope = x @ x - 1.0, 2 * x
        return Bounded(x - [3.0, 4.0], np.eye(2), np.array([over, -over]), np.stack([slope, -slope]))

    found = constrained_least_squares(circle, np.array([1.0, 0.1]), tolerance=1e-8)
    np.testing.assert_allclose(found.x, [0.6, 0.8], atol=1e-7)
    assert found.kept


def test_a_bent_valley_under_a_limit_is_that_of_another_optimiser():
    def rosenbrock(x):
        residuals = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        slopes = np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return Bounded(residuals, slopes, np.array([x @ x - 1.0]), 2 * x[None])

    found = constrained_least_squares(rosenbrock, np.array([-0.5, 0.5]), tolerance=1e-8)
    other = minimize(
        lambda x: 0.5 * np.sum(rosenbrock(x).residuals ** 2), [-0.5, 0.5], method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: 1.0 - x @ x}, options={"ftol": 1e-14},
    )  # fmt: skip
    np.testing.assert_allclose(found.x, other.x, atol=1e-5)


def test_bounds_hold_beside_limits():
    found = constrained_least_squares(line, np.zeros(2), upper=np.array([0.5, 9.0]), tolerance=1e-9)
    np.testing.assert_allclose(found.x, [0.5, 0.5], atol=1e-8)


def test_limits_that_contradict_each_other_are_not_kept():
    def none(x):
        return Bounded(x, np.eye(1), np.array([x[0] - 1.0, 2.0 - x[0]]), np.array([[1.0], [-1.0]]))

    found = constrained_least_squares(none, np.zeros(1), rounds=5)
    assert not found.kept and not found.converged and found.excess == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("wrong", [{"tolerance": 0.0}, {"rounds": 0}, {"steps": -1}])
def test_wrong_numbers_are_told(wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=f"{name}: expected a number above zero"):
        constrained_least_squares(line, np.zeros(2), **wrong)
