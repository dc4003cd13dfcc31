"""Feedforward is the inverse of the robot: rest, a motion, what it does when the pressures do not suffice."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.robot_bench import AMBIENT

from jaxmuscle import simulate
from jaxmuscle.robot import Motion, joint_motion, joints_along, line, pressure_commands, robot, tip
from jaxmuscle.robot.tondu2000 import robot_coefficients

STEP = 2e-3


def followed(machine, joints, times):
    commands = pressure_commands(machine, joints)
    begin = {"angle": joints.position[0], "pressure": commands[0]}
    return np.asarray(simulate(machine, commands, times, start=begin).readings["angle"])


@pytest.mark.slow
def test_a_posture_is_held():
    posture = jnp.tile(jnp.array([0.6, -1.1]), (500, 1))
    still = Motion(posture, 0 * posture, 0 * posture)
    angle = followed(robot(0.5, friction=False), still, np.arange(500) * STEP)
    np.testing.assert_allclose(angle, posture, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [True, False])
def test_the_tip_keeps_to_the_line_with_the_true_model(friction):
    # [T], Cartesian experiment. Left: the converters' lag of 2ζ/ω = 23 ms, 2.3 mm at 0.1 m/s, along the line.
    straight, machine = line([0.7, 0.3], [-0.1, 0.7], 0.1, 0.1), robot(friction=friction)
    times = np.arange(0, float(straight.duration), STEP)
    joints = joints_along(machine.arm, straight.at(times), 1)
    where = np.asarray(tip(machine.arm, jnp.asarray(followed(machine, joints, times))))
    off = 1e3 * (where - np.asarray(straight.at(times).position))
    across = off @ np.array([0.4, 0.8]) / np.hypot(0.4, 0.8)
    assert np.abs(across).max() < 1.0
    assert 0.5 < np.linalg.norm(off, axis=1).max() < 6.0


@pytest.mark.slow
def test_pressures_stay_within_zero_and_twice_the_mean():
    # Faster than the muscles can: the demand is cut off.
    motion, machine = joint_motion([-1.0, -1.0], [1.0, 1.0], 8.0, 60.0), robot()
    gauge = pressure_commands(machine, motion.at(np.linspace(0, 0.5, 200))) - AMBIENT
    assert float(gauge.min()) == pytest.approx(0, abs=1e-6)
    assert float(gauge.max()) == pytest.approx(5e5)
    pairs = gauge.reshape(-1, 2, 2).sum(axis=2)
    np.testing.assert_allclose(pairs, 5e5)


def test_coefficients_are_those_of_the_published_joint():
    assert float(2 * robot_coefficients(robot()).drive * 2.5e5) == pytest.approx(7.15, abs=0.01)
