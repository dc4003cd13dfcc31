"""Descents with secants in place of derivatives: against SciPy, and how often derivatives are taken."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from jaxmuscle.optimization.descents import BROKEN, CONVERGED, FAILED, STEPS, Limits
from jaxmuscle.optimization.secant_updates import Linearised, descend_by_secants

TIME = np.linspace(0.0, 4.0, 60)
DATA = 2.0 * np.exp(-0.7 * TIME) + 0.5 + 0.05 * np.random.default_rng(1).normal(size=60)
FREE = Limits(np.full(3, -np.inf), np.full(3, np.inf), 100, 1, samples=60)


def decay(u):
    return u[0] * np.exp(-u[1] * TIME) + u[2] - DATA


def decay_slopes(u):
    fast = np.exp(-u[1] * TIME)
    return np.stack([fast, -u[0] * TIME * fast, np.ones_like(TIME)])


def rosenbrock(u):
    return np.array([10 * (u[1] - u[0] ** 2), 1 - u[0]])


def rosenbrock_slopes(u):
    return np.array([[-20 * u[0], -1.0], [10.0, 0.0]])


class Counted:
    """The two functions that a descent takes, with how often each was called."""

    def __init__(self, values, slopes):
        self.evaluate, self.slopes, self.values, self.derivatives = values, slopes, 0, 0

    def plain(self, u):
        self.values += 1
        return self.evaluate(u)

    def linearised(self, u):
        self.derivatives += 1
        return self.evaluate(u), self.slopes(u)


def by_scipy(start, **options):
    jac: Any = lambda u: decay_slopes(u).T  # noqa: E731
    return optimize.least_squares(decay, start, jac=jac, **options)


def descended(values, slopes, start, limits):
    counted = Counted(values, slopes)
    return descend_by_secants(counted.plain, counted.linearised, np.array(start), limits), counted


@pytest.mark.parametrize("start", [[1.0, 0.1, 0.0], [3.0, 3.0, 1.0], [2.0, 0.7, 0.5]])
def test_the_minimum_is_that_of_scipy(start):
    lane, counted = descended(decay, decay_slopes, start, FREE)
    expected = by_scipy(start, xtol=1e-12, ftol=1e-12)
    assert lane.code == CONVERGED
    # Within the tolerance of the fall that is still expected, 1e-3 per mean square residual.
    assert lane.cost - expected.cost < 1e-3 * 2 * expected.cost / 60
    assert counted.derivatives <= counted.values


def test_bounds_hold():
    limits = dataclasses.replace(FREE, lower=np.array([0.0, 0.0, 0.0]), upper=np.array([5.0, 5.0, 0.3]))
    lane, _ = descended(decay, decay_slopes, [1.0, 0.1, 0.0], limits)
    expected = by_scipy([1.0, 0.1, 0.1], bounds=(limits.lower, limits.upper))
    assert lane.u[2] == 0.3 and lane.cost == pytest.approx(expected.cost, rel=1e-3)


def test_a_bent_valley_is_followed_to_its_end():
    limits = Limits(np.full(2, -np.inf), np.full(2, np.inf), 300, 1, samples=2)
    lane, _ = descended(rosenbrock, rosenbrock_slopes, [-1.2, 1.0], limits)
    np.testing.assert_allclose(lane.u, 1.0, atol=1e-2)


def test_of_a_straight_problem_derivatives_are_taken_once():
    matrix, shift = np.random.default_rng(2).normal(size=(3, 20)), np.arange(20.0)
    lane, counted = descended(
        lambda u: u @ matrix - shift, lambda u: matrix, np.zeros(3), dataclasses.replace(FREE, samples=20)
    )
    assert lane.code == CONVERGED
    # Once at the start, and once to make sure of the end.
    assert counted.derivatives <= 2


def test_a_secant_agrees_with_the_step_and_with_nothing_else():
    u, new = np.array([1.0, 0.1, 0.0]), np.array([1.3, 0.2, -0.1])
    here = Linearised(u, decay(u), decay_slopes(u))
    unit = np.array([1.0, 3.0, 0.5])
    there = here.at(new, decay(new), unit)
    np.testing.assert_allclose((new - u) @ there.slopes, decay(new) - decay(u), rtol=1e-10)
    beside = np.array([3.0, 0.0, -1.0]) * np.array([1.0, 1.0, 1.0])
    beside -= (new - u) * (beside @ (unit**2 * (new - u))) / ((new - u) @ (unit**2 * (new - u)))
    np.testing.assert_allclose(beside @ there.slopes, beside @ here.slopes, rtol=1e-9)


def test_predictions_that_are_not_numbers_are_left_again():
    """A trial beyond u[1] = 3 is broken; the descent turns back and ends sound."""

    def values(u):
        return np.where(u[1] > 3.0, np.nan, decay(u))

    lane, _ = descended(values, decay_slopes, [1.0, 2.9, 0.0], FREE)
    assert lane.code == CONVERGED and lane.u[1] == pytest.approx(0.7, abs=0.15)
    assert Linearised(lane.u, np.full(60, np.nan), np.zeros((3, 60))).local.cost == 0.5 * 60 * BROKEN**2


def test_no_prediction_at_the_start_is_told():
    lane, _ = descended(lambda u: np.full(60, np.nan), lambda u: np.zeros((3, 60)), [1.0, 0.1, 0.0], FREE)
    assert lane.code == FAILED and "start" in lane.reason


def test_steps_are_limited():
    lane, counted = descended(decay, decay_slopes, [3.0, 3.0, 1.0], dataclasses.replace(FREE, steps=2))
    assert lane.code == STEPS and counted.values == 2


def test_a_coordinate_that_counts_only_further_on_is_fitted():
    """A wall that the start does not touch: nothing was known of its stiffness, and the descent crashed."""

    def wall(u):
        return np.array([u[0] - 3.0, max(u[0] - 1.0, 0.0) * (u[1] - 2.0), 0.1 * np.sin(u[0])])

    def slopes(u):
        inside = max(u[0] - 1.0, 0.0)
        along = np.array([1.0, (u[1] - 2.0) * (u[0] > 1.0), 0.1 * np.cos(u[0])])
        return np.stack([along, np.array([0.0, inside, 0.0])])

    lane, _ = descended(
        wall, slopes, [0.0, 0.0], Limits(np.full(2, -9.0), np.full(2, 9.0), 100, 1, samples=3)
    )
    assert lane.code == CONVERGED
    assert lane.u == pytest.approx(optimize.least_squares(wall, (2.0, 1.0)).x, rel=1e-4)
