"""Dry friction at two coupled joints: the nearest point of the box, sticking, the single-joint law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.robot_bench import held, machine
from scipy.optimize import minimize

from jaxmuscle.actuators import Held
from jaxmuscle.effects.base import STICKING_TIME, slip_of_mass
from jaxmuscle.robot.friction import coupled_slip
from jaxmuscle.robot.reference import robot_arm

MASS = robot_arm().mass_matrix(jnp.array([0.0, 0.3]))
DRAWS = np.random.default_rng(4).normal(size=(40, 2, 2))


def slip(driving, velocity, limit, mass=MASS):
    return coupled_slip(jnp.asarray(driving), jnp.asarray(velocity), jnp.asarray(limit), mass)


@pytest.mark.parametrize("limit", [(1.0, 0.5), (0.2, 3.0), (2.0, 2.0)])
def test_is_the_nearest_point_of_the_box(limit):
    inverse, states = np.linalg.inv(MASS), set()
    for driving, velocity in DRAWS * [[2.0], [3e-3]]:
        wanted = driving + np.asarray(MASS) @ velocity / STICKING_TIME
        distance = lambda f, b=wanted: (b - f) @ inverse @ (b - f)  # noqa: E731
        bounds = [(-x, x) for x in limit]
        best = minimize(distance, np.clip(wanted, *np.transpose(bounds)), bounds=bounds, tol=1e-14)
        found = slip(driving, velocity, limit)
        assert (np.abs(found) <= 1).all()
        np.testing.assert_allclose(found * np.asarray(limit), best.x, atol=1e-5)
        states.add(tuple(np.abs(found) < 1))
    assert len(states) >= 3


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_sticking_joint_is_not_dragged_along(sense):
    # Joint 2 slides under a torque far above its limit; joint 1, at rest, holds against the reaction.
    driving, limit = np.array([0.0, 1.5 * sense]), np.array([5.0, 0.5])
    share = slip(driving, np.zeros(2), limit)
    acceleration = np.linalg.solve(MASS, driving - limit * share)
    assert acceleration[0] == pytest.approx(0, abs=1e-12)
    assert acceleration[1] == pytest.approx(sense * 1.0 / MASS[1, 1])
    assert share[1] == sense


def test_without_coupling_it_is_the_law_of_one_mass():
    mass = jnp.diag(jnp.array([0.6, 0.05]))
    for driving, velocity in DRAWS * [[2.0], [3e-3]]:
        expected = [
            slip_of_mass(jnp.asarray(f), jnp.asarray(m * v), jnp.asarray(0.7))
            for f, v, m in zip(driving, velocity, (0.6, 0.05), strict=True)
        ]
        np.testing.assert_allclose(slip(driving, velocity, (0.7, 0.7), mass), expected, atol=1e-12)


@pytest.mark.parametrize("limit", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)])
def test_no_limit_has_the_sign_of_the_motion(limit):
    for velocity in ([0.4, 0.3], [-0.4, 0.3], [0.4, -0.3]):
        found = slip((0.1, -0.1), velocity, limit)
        np.testing.assert_array_equal(found, np.sign(velocity))


def test_slopes_are_right_in_every_state():
    def flat(x):
        return coupled_slip(x[:2], 1e-3 * x[2:4], jnp.exp(x[4:6]), MASS) * jnp.exp(x[4:6])

    ends = np.tile([0.2, -0.7], (len(DRAWS), 1))
    x = jnp.asarray(np.hstack([2 * DRAWS.reshape(-1, 4), ends]))
    values, slopes = jax.jit(jax.vmap(flat)), jax.jit(jax.vmap(jax.jacfwd(flat)))
    at_limit = np.abs(values(x) / np.exp(ends)) > 1 - 1e-12
    assert len(set(map(tuple, np.sign(values(x)) * at_limit))) >= 6
    for i, e in enumerate(1e-6 * np.eye(6)):
        np.testing.assert_allclose(slopes(x)[:, :, i], (values(x + e) - values(x - e)) / 2e-6, atol=1e-7)
    at_rest = jax.jacrev(lambda x: coupled_slip(x[:2], x[2:4], x[4:], MASS))(jnp.zeros(6))
    assert np.isfinite(at_rest).all()


def test_does_not_creep_below_the_limit():
    actuator = machine()
    # Half of what the threads can hold at each joint.
    first = [2.6e5, 2.4e5, 2.4e5, 2.6e5]
    run = bench.simulated(actuator, held(first, first, [0.1, -0.2], 2000), 1)
    assert float(np.ptp(np.asarray(run.readings["angle"]), axis=0).max()) < 1e-12


def test_joint_2_sticks_while_joint_1_slides():
    actuator = machine()
    track = held([2.5e5] * 4, [4.2e5, 0.8e5, 2.5e5, 2.5e5], [0.0, 0.1], 300)
    angle = np.asarray(bench.simulated(actuator, track, 4).readings["angle"])
    assert np.ptp(angle[:, 0]) > 0.3
    assert np.ptp(angle[:40, 1]) < 1e-9 < np.ptp(angle[:40, 0])


def test_friction_takes_power_at_any_state():
    actuator, bare = machine(), machine(friction=False)
    pressure = jnp.asarray(bench.AMBIENT + np.full(4, 2.5e5))
    for angle, velocity in DRAWS[:10]:
        state = {"pressure": pressure, "pressure_rate": jnp.zeros(4)}
        state |= {"angle": jnp.asarray(0.3 * angle), "angular_velocity": jnp.asarray(velocity), "effects": {}}
        rubbed, free = (m.signals(state, Held(pressure, None, {})).load for m in (actuator, bare))
        assert float((rubbed - free) @ velocity) < 0
