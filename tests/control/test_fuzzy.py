"""The fuzzy PID of [T]: its rules one by one, between them, its limits and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.control import MACVICAR_WHELAN, FuzzyPID, JointModel
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import parameters, replace

STEP = 2e-3
RANGE, RATE = 0.3, 2.0
FUZZY = built(FuzzyPID, RANGE, RATE, 1.2e5, 4e5, 1.5e5)
JOINT = built(JointModel, 6.0, 60.0, 5e-4)


def test_table_is_the_one_of_the_textbooks():
    # Rows: error, columns: its rate, from negative big (-3) to positive big (3).
    rows = [
        "-3 -3 -3 -3 -2 -1  0",
        "-3 -3 -3 -2 -1  0  1",
        "-3 -3 -2 -1  0  1  2",
        "-3 -2 -1  0  1  2  3",
        "-2 -1  0  1  2  3  3",
        "-1  0  1  2  3  3  3",
        " 0  1  2  3  3  3  3",
    ]
    np.testing.assert_array_equal(3 * MACVICAR_WHELAN, [[int(n) for n in row.split()] for row in rows])


@pytest.mark.parametrize("i", range(-3, 4))
@pytest.mark.parametrize("j", range(-3, 4))
def test_at_a_rule_the_answer_is_that_rule(i, j):
    expected = max(-3, min(3, i + j)) / 3
    assert float(FUZZY.answer(i * RANGE / 3, j * RATE / 3)) == pytest.approx(expected, abs=1e-14)


def test_between_rules_it_is_the_weighted_mean_by_hand():
    # e is a quarter of the way from small to medium, its rate half the way from medium to big:
    # 0.75 and 0.25 times 0.5 and 0.5; the rules say 3, 3 and 3, 3 (of 3) there.
    assert float(FUZZY.answer(1.25 * RANGE / 3, 2.5 * RATE / 3)) == pytest.approx(1.0, abs=1e-14)
    # The same error with a rate a fifth of the way from small negative to zero:
    # 0.75 (0.8 · 0 + 0.2 · 1) + 0.25 (0.8 · 1 + 0.2 · 2), over 3.
    expected = (0.75 * 0.2 + 0.25 * 1.2) / 3
    assert float(FUZZY.answer(1.25 * RANGE / 3, -0.8 * RATE / 3)) == pytest.approx(expected, abs=1e-14)


def test_odd_and_held_beyond_the_ranges():
    rng = np.random.default_rng(0)
    for error, rate in rng.normal(size=(20, 2)) * [2 * RANGE, 2 * RATE]:
        there, back = FUZZY.answer(error, rate), FUZZY.answer(-error, -rate)
        assert float(there) == pytest.approx(-float(back), abs=1e-14)
        assert abs(float(there)) <= 1 + 1e-14
    assert float(FUZZY.answer(100.0, 0.0)) == 1.0
    assert float(FUZZY.answer(100.0, -100.0)) == 0.0


@pytest.mark.parametrize("measured", [0.05, 0.31])
def test_held_off_its_target_it_pushes_ever_harder_up_to_the_limit(measured):
    # Which is what [T] found unfit for leaning on a window pane: near and far the integral grows.
    state, commands = FUZZY.start(-measured), []
    for _ in range(4000):
        state, command = jit_update(state, 0.0, measured)
        commands.append(-float(command))
    assert np.all(np.diff(commands) >= 0) and commands[0] < commands[-1]
    assert commands[-1] == pytest.approx(1.5e5)


@jax.jit
def jit_update(state, wanted, measured):
    return FUZZY.update(state, jnp.asarray(wanted), jnp.asarray(measured), STEP)


def step_answer(controller, load=0.0, target=0.5):
    """Errors on a second-order joint after a step, semi-implicit Euler at the controller's rate."""

    def sample(carry, _):
        state, angle, velocity = carry
        state, command = controller.update(state, jnp.asarray(target), angle, STEP)
        rate = JOINT.gain * command - JOINT.damping * velocity - JOINT.stiffness * angle + load
        velocity = velocity + STEP * rate
        return (state, angle + STEP * velocity, velocity), state.error

    begin = (controller.start(target), jnp.zeros(()), jnp.zeros(()))
    return jax.lax.scan(sample, begin, None, length=2000)[1]


def test_integral_removes_the_error_at_rest():
    without = replace(FUZZY, {"integral": 0.0})
    assert abs(float(step_answer(without, load=-5.0)[-1])) > 0.05
    assert abs(float(step_answer(FUZZY, load=-5.0)[-1])) < 1e-3


@pytest.mark.slow
def test_derivatives_equal_finite_differences():
    paths = [path for path in parameters(FUZZY) if path not in ("limit", "table")]

    def cost(values):
        return jnp.sum(step_answer(replace(FUZZY, dict(zip(paths, values, strict=True))))[:600] ** 2)

    values = jnp.array([float(parameters(FUZZY)[path].value) for path in paths])
    forward, slope, cost = jax.jit(jax.jacfwd(cost))(values), jax.jit(jax.grad(cost))(values), jax.jit(cost)
    np.testing.assert_allclose(slope, forward, rtol=1e-9)
    for i, value in enumerate(values):
        size = 1e-5 * value
        difference = (cost(values.at[i].add(size)) - cost(values.at[i].add(-size))) / (2 * size)
        assert float(slope[i]) == pytest.approx(float(difference), rel=1e-4)


@pytest.mark.slow
def test_slope_at_a_rule_lies_between_both_sides_and_none_is_missing():
    slope = jax.grad(FUZZY.answer)
    sides = [float(slope(2 * RANGE / 3 + s * 1e-6, RATE / 3)) for s in (-1, 1)]
    assert sides[0] == pytest.approx(1 / RANGE) and sides[1] == pytest.approx(0.0)
    at = float(slope(2 * RANGE / 3, RATE / 3))
    assert min(sides) <= at <= max(sides)
    many = jax.vmap(slope)(jnp.linspace(-2, 2, 97) * RANGE, jnp.linspace(2, -2, 97) * RATE)
    assert bool(jnp.isfinite(many).all())


@pytest.mark.parametrize("place", [0, 1])
def test_a_reading_that_is_missing_is_not_taken_for_zero(place):
    wanted, measured = jnp.array([0.1, 0.2]).at[place].set(jnp.nan)
    state, command = FUZZY.update(FUZZY.start(), wanted, measured, STEP)
    assert jnp.isnan(command) and jnp.isnan(state.integral)
    assert np.isnan(FUZZY.answer(0.1, np.nan)) and np.isnan(FUZZY.answer(np.nan, 0.1))
    slope = jax.grad(lambda e: jnp.where(jnp.isnan(e), 0.0, FUZZY.answer(e, 0.0)))(0.31 * RANGE)
    assert float(slope) == pytest.approx(1 / RANGE)


@pytest.mark.parametrize("shape", [(7,), (5, 5), (7, 6)])
def test_a_table_of_another_shape_is_refused(shape):
    with pytest.raises(InputError, match=r"expected a rule table of shape \(7, 7\).*got"):
        built(FuzzyPID, RANGE, RATE, 1e5, 1e5, table=np.zeros(shape))


def test_derivatives_over_the_table_are_the_memberships():
    slopes = jax.grad(lambda c: c.answer(1.25 * RANGE / 3, 0.0))(FUZZY).table
    expected = np.zeros((7, 7))
    expected[[4, 5], 3] = 0.75, 0.25
    np.testing.assert_allclose(slopes, expected, atol=1e-14)
