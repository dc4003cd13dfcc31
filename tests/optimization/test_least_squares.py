"""Our minimiser beside SciPy's trf on well-known problems with bounds: the same minima, as quickly."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
import scipy.optimize

from jaxmuscle.errors import InputError
from jaxmuscle.optimization.least_squares import least_squares, with_jacobian
from jaxmuscle.optimization.optimistix_solver import steps_by

INF = np.inf
TIMES = np.linspace(0, 4, 50)
DECAY = 2 * np.exp(-1.3 * TIMES) + 0.5 + 0.02 * np.random.default_rng(0).normal(size=50)
FULL = np.random.default_rng(1).normal(size=(30, 3))
DEFICIENT = np.column_stack([FULL, FULL[:, 0] - 2 * FULL[:, 1]])
TARGET = np.random.default_rng(2).normal(size=30)


def rosenbrock(x, _=None):
    return jnp.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def powell(x, _=None):
    """Singular: JᵀJ has rank 2 at the minimum 0 at the origin."""
    return jnp.array(
        [
            x[0] + 10 * x[1],
            np.sqrt(5) * (x[2] - x[3]),
            (x[1] - 2 * x[2]) ** 2,
            np.sqrt(10) * (x[0] - x[3]) ** 2,
        ]
    )


def brown_dennis(x, _=None):
    """Residuals of a thousand at the minimum: Gauss-Newton converges slowly."""
    t = jnp.arange(1, 21) / 5
    return (x[0] + t * x[1] - jnp.exp(t)) ** 2 + (x[2] + x[3] * jnp.sin(t) - jnp.cos(t)) ** 2


def kowalik_osborne(x, _=None):
    y = "0.1957 0.1947 0.1735 0.16 0.0844 0.0627 0.0456 0.0342 0.0323 0.0235 0.0246"
    v = jnp.array([4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])
    return np.array(y.split(), float) - x[0] * (v**2 + v * x[1]) / (v**2 + v * x[2] + x[3])


def biggs(x, _=None):
    """EXP6: minima 0 where the exponentials are those of the data, in either order."""
    t = jnp.arange(1, 14) / 10
    y = jnp.exp(-t) - 5 * jnp.exp(-10 * t) + 3 * jnp.exp(-4 * t)
    return x[2] * jnp.exp(-t * x[0]) - x[3] * jnp.exp(-t * x[1]) + x[5] * jnp.exp(-t * x[4]) - y


def decay(x, _=None):
    return x[0] * jnp.exp(-x[1] * TIMES) + x[2] - DECAY


def deficient(x, _=None):
    """One direction of four is not seen at all."""
    move = DEFICIENT @ x
    return move + 0.1 * jnp.sin(move) - TARGET


PROBLEMS = {
    # Moré, Garbow and Hillstrom 1981; bounds of Gay 1984 where they fit, our own otherwise.
    "Rosenbrock": (rosenbrock, [-1.2, 1], -INF, INF, 0.0),
    "Rosenbrock, bounds": (rosenbrock, [-1.2, 1], [-50, 0], [0.5, 100], 0.125),
    "Powell singular": (powell, [3, -1, 0, 1], -INF, INF, 0.0),
    "Powell singular, bounds": (powell, [3, -1, 0.2, 1], [0.1, -20, -20, -20], [100, 20, 20, 1.1], None),
    "Brown-Dennis": (brown_dennis, [25, 5, -5, -1], -INF, INF, 42911.1),
    "Brown-Dennis, bounds": (brown_dennis, [25, 5, -5, -1], [-10, 0, -100, -20], [100, 15, 0, 0.2], 44430.2),
    "Kowalik-Osborne": (kowalik_osborne, [0.25, 0.39, 0.415, 0.39], -INF, INF, 1.53753e-4),
    "Kowalik-Osborne, bounds": (
        kowalik_osborne, [0.25, 0.1, 0.415, 0.39], [0.1, 0, 0, 0], [1, 0.15, 1, 1], None
    ),
    "Biggs EXP6": (biggs, [1, 2, 1, 1, 1, 1], -INF, INF, 0.0),
    "Biggs EXP6, bounds": (biggs, [1, 2, 1, 1, 1, 1], [0, 0, 0, 1, 0, 0], [2, 8, 1, 7, 5, 5], 2.66049e-4),
    "decay": (decay, [1, 1, 1], -INF, INF, None),
    "decay, two active bounds": (decay, [1, 1, 1], [0, 0, 0.6], [1.7, 10, 10], None),
    "decay, bounds on either side": (decay, [1.5, 2, 0.1], [0, 1.5, 0], [1.8, INF, INF], None),
    "rank-deficient": (deficient, [1, 1, 1, 1], -INF, INF, None),
    "rank-deficient, bounds": (deficient, [1, 1, 1, 1], [-0.1, 0, -0.1, -0.2], [2, 2, 2, 2], None),
}  # fmt: skip
"""Residuals, start, bounds, and the published cost at the minimum where there is one."""
SLOW = ("Brown-Dennis", "Brown-Dennis, bounds")
"""Where costs that differ by a millionth belong to points that differ by a thousandth."""
SEVERAL = ("Powell singular", "Biggs EXP6", "rank-deficient", "rank-deficient, bounds")
"""Where the minimum is not one point, or its matrix is singular."""
DETERMINED = [name for name in PROBLEMS if name not in (*SLOW, *SEVERAL)]


def ours(name, **how):
    """The minimum from the problem's start."""
    residuals, start, lower, upper, _ = PROBLEMS[name]
    function = with_jacobian(residuals, None)
    return least_squares(function, np.array([start]), lower=np.array(lower), upper=np.array(upper), **how)


def scipys(name):
    """The same by SciPy, likewise with each coordinate in units of the Jacobian's columns."""
    residuals, start, lower, upper, _ = PROBLEMS[name]
    function = with_jacobian(residuals, None)
    return scipy.optimize.least_squares(
        lambda x: function(x)[0],
        np.array(start, float),
        lambda x: function(x)[1],  # pyright: ignore[reportArgumentType]
        (lower, upper),
        "trf",
        x_scale="jac",
    )


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_minimum_is_scipys_in_no_more_than_twice_the_evaluations(name):
    found, theirs, published = ours(name), scipys(name), PROBLEMS[name][4]
    assert found.cost <= theirs.cost * (1 + 1e-5) + 1e-12
    if published is not None:
        assert found.cost == pytest.approx(published, rel=1e-5, abs=1e-12)
    assert found.evaluations <= 2 * theirs.nfev
    if name in DETERMINED:
        np.testing.assert_allclose(found.x, theirs.x, rtol=2e-4, atol=2e-5)
        # Where trf stays just inside a bound, ours is on it.
        _, _, lower, upper, _ = PROBLEMS[name]
        near = [np.abs(theirs.x - np.array(bound)) < 1e-4 for bound in (lower, upper)]
        np.testing.assert_array_equal(found.at_bound, near[0] | near[1])


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_says_that_a_minimum_is_reached_and_how_slowly_it_is_approached(name):
    # On residuals of a thousand the last digits of the cost fall by less than a step is worth.
    assert ours(name).code == ("stalled" if name == "Brown-Dennis" else "converged")


def test_the_gradient_is_zero_inside_and_points_outwards_on_a_bound():
    for name in PROBLEMS:
        residuals, start, lower, upper, _ = PROBLEMS[name]
        found, function = ours(name), with_jacobian(residuals, None)
        r, jacobian = function(found.x)
        # Of a coordinate in units of its column: the cosine between the residuals and the column. Where the
        # minimum is an exact fit what is left of the residuals is rounding, and has no direction.
        least = 1e-6 * np.linalg.norm(function(np.asarray(start, dtype=float))[0])
        size = np.linalg.norm(jacobian, axis=0) * max(np.linalg.norm(r), least)
        slope = r @ jacobian / np.where(size > 0, size, 1.0)
        inside = ~found.at_bound
        assert np.all(np.abs(slope[inside]) < 2e-3), name
        assert np.all(slope[found.x == np.array(lower)] > 0) and np.all(slope[found.x == np.array(upper)] < 0)


def test_covariance_is_scipys_curve_fit():
    found = ours("decay")
    curve = lambda t, a, rate, level: a * np.exp(-rate * t) + level  # noqa: E731
    x, covariance = scipy.optimize.curve_fit(curve, TIMES, DECAY, [1, 1, 1])
    np.testing.assert_allclose(found.x, x, rtol=1e-5)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-4)


def test_covariance_at_a_bound_is_that_of_a_fit_without_the_coordinate():
    found = ours("decay, two active bounds")
    assert found.at_bound.tolist() == [True, False, True]
    curve = lambda t, rate: 1.7 * np.exp(-rate * t) + 0.6  # noqa: E731
    _, variance = scipy.optimize.curve_fit(curve, TIMES, DECAY, [1.0])
    expected = np.zeros((3, 3))
    expected[1, 1] = variance[0, 0]
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-4)


def test_the_best_of_several_starts():
    function = with_jacobian(lambda x, _: jnp.array([x[0] ** 2 - 4, 0.1 * (x[0] - 2)]), None)
    found = least_squares(function, np.array([[-3.0], [3.0]]))
    assert found.cost < 1e-15 and found.x[0] == pytest.approx(2.0) and found.converged


def test_from_the_minimum_it_goes_nowhere():
    function = with_jacobian(lambda x, _: jnp.exp(-x[0] * TIMES) - jnp.exp(-1.3 * TIMES), None)
    found = least_squares(function, np.array([[1.3]]))
    assert found.converged and found.evaluations == 1


def test_no_number_anywhere_is_told():
    function = with_jacobian(lambda x, _: jnp.log(x), None)
    with pytest.raises(
        InputError, match="at none of 2 starts are all residuals and their derivatives numbers"
    ):
        least_squares(function, np.array([[-1.0], [-2.0]]))


SOLVERS = {
    "LevenbergMarquardt": optx.LevenbergMarquardt(1e-6, 1e-6),
    "Dogleg": optx.Dogleg(1e-6, 1e-6),
    "GaussNewton": optx.GaussNewton(1e-6, 1e-6),
    "BFGS": optx.BFGS(1e-6, 1e-6),
    "BestSoFar": optx.BestSoFarLeastSquares(optx.LevenbergMarquardt(1e-6, 1e-6)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_of_optimistix_reach_the_same_minima_within_bounds(name):
    for problem in ("Rosenbrock, bounds", "decay, two active bounds", "decay, bounds on either side"):
        found, own = ours(problem, solver=steps_by(SOLVERS[name])), ours(problem)
        assert found.converged, problem
        assert found.cost == pytest.approx(own.cost, rel=1e-6), problem
        np.testing.assert_allclose(found.x, own.x, rtol=2e-4, atol=1e-5)
        np.testing.assert_array_equal(found.at_bound, own.at_bound)


def test_a_solver_bears_a_direction_that_is_not_seen():
    solver = steps_by(SOLVERS["LevenbergMarquardt"])
    found = ours("rank-deficient, bounds", solver=solver)
    assert found.cost == pytest.approx(ours("rank-deficient, bounds").cost, rel=1e-6) and found.converged


def test_coordinates_leave_a_bound_to_which_a_solver_took_them():
    """The first Gauss-Newton step overshoots to the bound; the minimum is inside."""

    def bent(x, _):
        return jnp.array([jnp.arctan(3 * (x[0] - 1)), 0.01 * x[1]])

    found = least_squares(
        with_jacobian(bent, None),
        np.array([[2.2, 1.0]]),
        lower=np.array([0.6, -5.0]),
        solver=steps_by(SOLVERS["GaussNewton"]),
    )
    assert found.converged and not found.at_bound.any()
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-6)


def test_a_solver_that_ends_where_it_is_worse_than_before_has_not_converged():
    found = ours("Biggs EXP6, bounds", solver=steps_by(SOLVERS["GaussNewton"]))
    assert found.code == "stalled" and found.cost > 2 * ours("Biggs EXP6, bounds").cost


def test_steps_run_out_with_the_best_so_far():
    few = [ours("Rosenbrock", solver=steps_by(SOLVERS["LevenbergMarquardt"]), steps=n) for n in (3, 9)]
    assert [found.code for found in few] == ["steps", "steps"]
    assert few[0].evaluations == 4 and few[1].cost < few[0].cost < 12.1


def test_what_is_no_solver_is_told():
    wrong = {
        "got 3": 3,
        "got <class": optx.LevenbergMarquardt,
        r"got Newton\(": optx.Newton(1e-3, 1e-3),
        "NelderMead does not step by derivatives": optx.NelderMead(1e-3, 1e-3),
        "GoldenSearch does not step by derivatives": optx.GoldenSearch(1e-3, 1e-3),
    }
    for said, solver in wrong.items():
        with pytest.raises(InputError, match=said):
            steps_by(solver)
