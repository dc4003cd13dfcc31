"""Forward and inverse kinematics: MuJoCo's positions, both elbows, what is out of reach."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import robot as oracle
from oracles.robot_bench import UNEQUAL, card, machine

from jaxmuscle.errors import InputError
from jaxmuscle.robot import angles_at, inverse, jacobian, tip
from jaxmuscle.robot.kinematics import rates_along

ROBOT = machine(UNEQUAL)
ARM = ROBOT.arm
ANGLES = np.random.default_rng(2).uniform(-2, 2, (12, 2))


def test_tip_and_jacobian_equal_mujoco():
    for angle in ANGLES:
        where, turning = oracle.tip(card(ROBOT), angle)
        np.testing.assert_allclose(tip(ARM, jnp.asarray(angle)), where, atol=1e-14)
        np.testing.assert_allclose(jacobian(ARM, jnp.asarray(angle)), turning, atol=1e-14)


def test_jacobian_is_the_derivative_of_the_tip():
    slopes = jax.vmap(jax.jacfwd(lambda q: tip(ARM, q)))(jnp.asarray(ANGLES))
    np.testing.assert_allclose(jacobian(ARM, jnp.asarray(ANGLES)), slopes, atol=1e-14)


@pytest.mark.parametrize("elbow", [1, -1])
def test_both_solutions_reach_the_point(elbow):
    points = tip(ARM, jnp.asarray(ANGLES))
    found = inverse(ARM, points, elbow)
    np.testing.assert_allclose(tip(ARM, found), points, atol=1e-13)
    assert (np.sign(found[:, 1]) == elbow).all()
    assert (np.abs(found[:, 0]) <= np.pi).all()


def test_the_solution_with_the_elbow_of_the_angles_is_the_angles():
    for angle in ANGLES:
        found = inverse(ARM, tip(ARM, jnp.asarray(angle)), int(np.sign(angle[1])))
        np.testing.assert_allclose(found, angle, atol=1e-12)


@pytest.mark.parametrize("point", [(0.81, 0.0), (0.6, 0.6), (0.01, 0.0), (np.nan, 0.1)])
def test_out_of_reach_is_told(point):
    with pytest.raises(InputError, match=r"out of reach.*reaches from 0\.06 to 0\.8 m"):
        inverse(ARM, [(0.5, 0.2), point], 1)


def test_the_base_itself_is_out_of_reach_of_equal_links():
    with pytest.raises(InputError, match="out of reach"):
        inverse(machine().arm, (0.0, 0.0), 1)


def test_the_stretched_arm_is_within_reach():
    np.testing.assert_allclose(inverse(machine().arm, (0.8, 0.0), 1), 0, atol=1e-7)


@pytest.mark.parametrize(
    ("elbow", "point", "message"), [(0, (0.5, 0.1), "elbow"), (1, (0.5, 0.1, 0.0), "two")]
)
def test_wrong_questions_are_told(elbow, point, message):
    with pytest.raises(InputError, match=message):
        inverse(ARM, point, elbow)


def test_slope_of_the_inverse_is_the_inverse_slope():
    for angle in ANGLES:
        point = tip(ARM, jnp.asarray(angle))
        side = 1 if angle[1] > 0 else -1
        slope = jax.jacfwd(angles_at, argnums=1)(ARM, point, side)
        np.testing.assert_allclose(slope @ jacobian(ARM, jnp.asarray(angle)), np.eye(2), atol=1e-9)


def test_rates_along_undo_the_motion_of_the_tip():
    angle, rate, bend = jnp.asarray(np.random.default_rng(3).uniform(0.3, 1.5, (3, 2)))
    path = lambda t: tip(ARM, angle + rate * t + 0.5 * bend * t**2)  # noqa: E731
    velocity = lambda t: jax.jvp(path, (t,), (1.0,))[1]  # noqa: E731
    acceleration = jax.jvp(velocity, (0.0,), (1.0,))[1]
    found = rates_along(ARM, angle, velocity(0.0), acceleration)
    np.testing.assert_allclose(found, (rate, bend), atol=1e-11)
