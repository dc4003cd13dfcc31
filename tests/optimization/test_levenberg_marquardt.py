"""Steps within a radius against a plain search for the damping, and the fall of a quadratic model.

Levenberg-Marquardt from many starts, on functions whose minima are known.
"""

import dataclasses
import time

import numpy as np
import pytest
from scipy.optimize import brentq

from jaxmuscle.optimization.descents import (
    BUDGET,
    CONVERGED,
    FAILED,
    OUT_OF_REACH,
    STALLED,
    STEPS,
    Limits,
    Local,
    Tolerances,
    best,
)
from jaxmuscle.optimization.levenberg_marquardt import FIRST_DAMPING, RADIUS_TOLERANCE, Quadratic, descend

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
    np.testing.assert_allclose(UNIT * step, UNIT * expected, atol=2 * RADIUS_TOLERANCE * radius)


def test_a_direction_without_curvature_does_not_make_a_step_infinite():
    flat = np.outer([1.0, 1.0], [1.0, 1.0])
    step = Quadratic(flat, np.array([1.0, 1.0]), np.ones(2)).within(10.0)
    assert np.isfinite(step).all() and step == pytest.approx([-0.5, -0.5])


FREE = Limits(np.full(2, -np.inf), np.full(2, np.inf), 200, 3, samples=2)


def least_squares(function, calls=None):
    """`evaluate` from residuals and their derivatives; notes in `calls` how many points came at a time."""
    calls = [] if calls is None else calls

    def evaluate(points):
        calls.append(len(points))
        found = []
        for u in points:
            r, jacobian = function(u)
            cost = 0.5 * float(r @ r)
            found.append(Local(cost, jacobian.T @ r, jacobian.T @ jacobian, int((~np.isfinite(r)).sum())))
        return found

    return evaluate


def rosenbrock(u):
    """Minimum 0 at (1, 1), in a bent valley."""
    return np.array([10 * (u[1] - u[0] ** 2), 1 - u[0]]), np.array([[-20 * u[0], 10.0], [-1.0, 0.0]])


def bowl(u):
    """Minimum at (3, -2)."""
    slope = np.array([[1.0, 0.0], [0.5, 2.0]])
    return slope @ (u - np.array([3.0, -2.0])), slope


def test_a_bent_valley_from_many_starts():
    starts = np.random.default_rng(0).uniform(-2, 2, (7, 2))
    lanes = descend(least_squares(rosenbrock), starts, FREE)
    assert [lane.code for lane in lanes] == [CONVERGED] * 7
    for lane, start in zip(lanes, starts, strict=True):
        np.testing.assert_allclose(lane.u, 1.0, atol=1e-2)
        np.testing.assert_array_equal(lane.start, start)


def test_no_more_are_under_way_than_allowed_and_none_that_has_ended():
    calls: list[int] = []
    lanes = descend(least_squares(bowl, calls), np.zeros((5, 2)), FREE)
    assert calls[0] == 3 and max(calls) == 3
    # A point for the start of each lane and one for each of its steps.
    assert sum(calls) == sum(1 + lane.steps for lane in lanes)
    assert all(lane.code == CONVERGED for lane in lanes)


def test_a_start_takes_the_place_of_one_that_ended():
    """Five lanes through three places take fewer rounds than two batches one after the other."""
    courses = []
    starts = np.array([[3.0, -2.0], [3.0, -2.0], [-2.0, 2.0], [-1.5, 2.0], [-2.0, 1.5]])
    descend(least_squares(bowl), starts, FREE, tell=courses.append)
    assert courses[0].waiting == 2 and courses[0].ended == 2
    assert courses[-1].active == 0 and courses[-1].ended == 5
    assert all(a.cost >= b.cost for a, b in zip(courses[:-1], courses[1:], strict=True))


def test_bounds_hold_and_the_rest_moves_on():
    limits = Limits(np.array([-np.inf, -1.0]), np.array([2.0, np.inf]), 200, 1, samples=2)
    (lane,) = descend(least_squares(bowl), np.zeros((1, 2)), limits)
    assert lane.code == CONVERGED
    # The minimum of the bowl on the edges u0 = 2, u1 = -1: both gradients push outward there.
    np.testing.assert_array_equal(lane.u, [2.0, -1.0])
    wide = Limits(np.full(2, -np.inf), np.array([2.0, np.inf]), 200, 1, samples=2)
    (lane,) = descend(least_squares(bowl), np.zeros((1, 2)), wide)
    # On u0 = 2: (u0 - 3)/2 + 2 (u1 + 2) = 0.
    np.testing.assert_allclose(lane.u, [2.0, -1.75], atol=1e-3)


def test_held_coordinates_stay():
    held = np.array([[True, False], [False, True]])
    lanes = descend(least_squares(bowl), np.array([[1.0, 5.0], [5.0, 0.0]]), FREE, held)
    assert lanes[0].u[0] == 1.0 and lanes[1].u[1] == 0.0
    assert lanes[0].u[1] == pytest.approx(-1.5, abs=1e-3) and all(lane.code == CONVERGED for lane in lanes)


def test_a_start_of_no_number_fails_alone():
    def broken(u):
        r, jacobian = bowl(u)
        return (r, jacobian) if u[0] < 50 else (r * np.nan, jacobian)

    lanes = descend(least_squares(broken), np.array([[0.0, 0.0], [90.0, 0.0], [5.0, 5.0]]), FREE)
    assert [lane.code for lane in lanes] == [CONVERGED, FAILED, CONVERGED]
    assert lanes[1].reason == "no finite prediction at its start"
    assert best(lanes) is not lanes[1]
    assert best([lanes[1]]) is None


def test_a_coordinate_reaches_as_far_as_it_may():
    """A linear coordinate with a narrow prior may go far in one step; a logarithm by a factor of 4.5."""
    far = Limits(FREE.lower, FREE.upper, 1, 1, samples=2, reach=np.array([1.0, 20.0]))
    (lane,) = descend(least_squares(lambda u: (u - 15.0, np.eye(2))), np.zeros((1, 2)), far)
    np.testing.assert_allclose(lane.u, [1.5, 15.0 / (1 + FIRST_DAMPING)], rtol=1e-9)


def test_a_cliff_is_stepped_back_from():
    """Beyond u0 = 3.5 there is no number; the minimum is before it."""

    def cliff(u):
        r, jacobian = rosenbrock(u)
        return (r, jacobian) if u[1] < 3.0 else (r * np.nan, jacobian * np.nan)

    (lane,) = descend(least_squares(cliff), np.array([[-1.5, 2.9]]), FREE)
    assert lane.code == CONVERGED
    np.testing.assert_allclose(lane.u, 1.0, atol=1e-2)


def test_wrong_slopes_stall():
    def lying(u):
        r, jacobian = bowl(u)
        return r, -jacobian

    (lane,) = descend(least_squares(lying), np.zeros((1, 2)), FREE)
    assert lane.code == STALLED
    np.testing.assert_array_equal(lane.u, 0.0)


def test_steps_and_time_run_out_with_the_best_so_far():
    few = Limits(FREE.lower, FREE.upper, 2, 1, samples=2)
    (lane,) = descend(least_squares(rosenbrock), np.array([[-1.5, 2.0]]), few)
    assert lane.code == STEPS and lane.steps == 2
    late = Limits(FREE.lower, FREE.upper, 200, 1, time.monotonic(), samples=2)
    lanes = descend(least_squares(rosenbrock), np.array([[-1.5, 2.0], [0.0, 0.0]]), late)
    assert lanes[0].code == BUDGET and np.isfinite(lanes[0].cost)
    assert (lanes[1].code, lanes[1].reason) == (FAILED, "not begun in time")


def test_the_cheapest_starts_go_first_and_none_is_left_out():
    starts, looked = np.array([[-1.5, 2.0], [8.0, -5.0], [0.9, 0.8]]), []
    limits = dataclasses.replace(FREE, lanes=1, best_first=True)
    calls: list[int] = []

    def evaluate(points):
        looked.extend(points)
        return least_squares(rosenbrock, calls)(points)

    lanes = descend(evaluate, starts, limits)
    own = [len(descend(least_squares(rosenbrock), start[None], FREE)[0].costs) for start in starts]
    assert calls[0] == 3 and calls[1:] == [1] * (sum(own) - 3)
    assert [lane.start.tolist() for lane in lanes] == starts.tolist()
    assert np.linalg.norm(looked[3] - starts[2]) < np.linalg.norm(looked[3] - starts[0])
    for lane in lanes:
        assert lane.code == CONVERGED and lane.u == pytest.approx(np.ones(2), abs=1e-4)
    late = dataclasses.replace(limits, deadline=time.monotonic())
    assert {lane.code for lane in descend(least_squares(rosenbrock), starts, late)} == {BUDGET}


def test_a_coordinate_without_influence_stays():
    def flat(u):
        r, jacobian = bowl(np.array([u[0], -2.0]))
        return r, jacobian * np.array([1.0, 0.0])

    (lane,) = descend(least_squares(flat), np.array([[0.0, 7.0]]), FREE)
    assert lane.code == CONVERGED
    assert lane.u[1] == 7.0 and lane.u[0] == pytest.approx(3.0)


def test_what_noise_leaves_does_not_count_where_falls_are_judged():
    """A slow valley beside a cost of 5000 that nothing lowers: by the whole cost its descent ends early."""

    def evaluate(points):
        found = []
        for x, y in points:
            r, slopes = np.array([1 - x, 10 * (y - x**2)]), np.array([[-1.0, 0.0], [-20 * x, 10.0]])
            found.append(Local(5000 + 0.5 * float(r @ r), slopes.T @ r, slopes.T @ slopes, 0))
        return found

    def end(**ends):
        tolerances = Tolerances(near=0.0, noticeable=0.0, fall=1e-4, slow=1e-3, **ends)
        limits = Limits(
            np.full(2, -9.0), np.full(2, 9.0), 200, 1, samples=10_000, reach=0.1, tolerances=tolerances
        )
        (lane,) = descend(evaluate, np.array([[-1.2, 1.0]]), limits)
        return lane.cost - 5000

    assert end() > 0.5
    assert end(floor=5000.0, least=1e-3) < 1e-3


@pytest.mark.parametrize("goal, code", [(0.4, OUT_OF_REACH), (0.6, CONVERGED)])
def test_a_goal_below_what_the_quadratic_model_promises_ends_a_descent(goal, code):
    # The minimum has cost 1/2: a residual of 1 that nothing moves.
    def function(u):
        return np.array([u[0] - 3.0, u[1] + 1.0, 1.0]), np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])

    calls = []
    limits = dataclasses.replace(FREE, tolerances=Tolerances(goal=goal, reach=1.0))
    (lane,) = descend(least_squares(function, calls), np.zeros((1, 2)), limits)
    assert lane.code == code
    assert len(calls) == 1 if code == OUT_OF_REACH else lane.cost == pytest.approx(0.5)


def test_a_descent_ends_where_what_is_expected_is_not_worth_a_step():
    def function(u):
        return np.array([u[0] - 3.0, u[1] + 1.0]), np.eye(2)

    limits = dataclasses.replace(FREE, tolerances=Tolerances(enough=6.0))
    (lane,) = descend(least_squares(function), np.zeros((1, 2)), limits)
    assert lane.code == CONVERGED and lane.cost == 5.0
