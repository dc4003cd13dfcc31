"""Pseudo-trapezoidal motions: limits kept and used, starts and ends, straight lines, the paper's examples."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle.errors import InputError
from jaxmuscle.robot import Trapezoid, joint_motion, joints_along, line, tip
from jaxmuscle.robot.tondu2000 import robot_arm

ARM = robot_arm()
A, B = np.array([0.7, 0.3]), np.array([-0.1, 0.7])
"""[T], Cartesian experiment [m]."""


def trapezoid(cruise, slope):
    return Trapezoid(jnp.asarray(cruise), jnp.asarray(slope))


@pytest.mark.parametrize(("cruise", "slope"), [(0.5, 2.0), (0.5, 0.25), (3.0, 1.0)])
def test_profile_keeps_to_its_limits_and_arrives(cruise, slope):
    profile = trapezoid(cruise, slope)
    end = float(profile.duration)
    t = jnp.linspace(-0.5, end + 0.5, 2001)
    way, speed, rate = profile.position(t), profile.velocity(t), profile.acceleration(t)
    assert float(speed.max()) == pytest.approx(min(cruise, np.sqrt(slope)), rel=1e-2)
    assert float(jnp.abs(speed).max()) <= cruise * (1 + 1e-12)
    assert float(speed.min()) >= -1e-15
    assert float(jnp.abs(rate).max()) == slope
    assert not np.asarray(way[t <= 0]).any() and not np.asarray(rate[(t < 0) | (t >= end)]).any()
    np.testing.assert_allclose(way[t >= end], 1, rtol=1e-12)
    np.testing.assert_allclose(speed[t >= end], 0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("cruise", "slope"), [(0.5, 2.0), (3.0, 1.0)])
def test_velocity_and_acceleration_are_derivatives(cruise, slope):
    profile = trapezoid(cruise, slope)
    end, rise = float(profile.duration), float(profile.rise)
    t = jnp.linspace(0.0123, end - 0.0123, 96)
    switches = jnp.array([0.0, rise, end - rise, end])
    for times in (t, switches):
        slope = jax.vmap(jax.grad(profile.position))(times)
        np.testing.assert_allclose(slope, profile.velocity(times), atol=1e-12)
    np.testing.assert_allclose(jax.vmap(jax.grad(profile.velocity))(t), profile.acceleration(t), atol=1e-12)


def test_duration_in_closed_form():
    # With a plateau: d/v + v/a; without: 2 sqrt(d/a).
    assert float(trapezoid(0.5, 2.0).duration) == pytest.approx(2.25)
    assert float(trapezoid(3.0, 1.0).duration) == pytest.approx(2.0)


def test_joints_keep_to_the_limits_of_each_and_arrive_together():
    motion = joint_motion([-1.0, 0.5], [1.0, 0.2], [0.5, 1.0], [0.5, 0.1])
    t = np.linspace(0, float(motion.duration), 1001)
    position, velocity, acceleration = motion.at(t)
    peaks = np.abs(velocity).max(axis=0), np.abs(acceleration).max(axis=0)
    assert (peaks[0] <= [0.5 + 1e-12, 1.0]).all() and (peaks[1] <= [0.5 + 1e-12, 0.1]).all()
    assert peaks[0][0] == pytest.approx(0.5)
    assert peaks[1][0] == pytest.approx(0.5)
    np.testing.assert_allclose(position[-1], [1.0, 0.2], rtol=1e-12)
    share = (position - position[0]) / (position[-1] - position[0])
    np.testing.assert_allclose(share[:, 0], share[:, 1], atol=1e-12)


def test_three_times_to_and_fro():
    # [T], joint experiment: -1 to 1 rad at 0.5 rad/s and 0.5 rad/s^2, three times: 5 s a way, 30 s in all.
    motion = joint_motion([-1.0, 0.0], [1.0, 0.0], 0.5, 0.5)
    assert float(motion.duration) == pytest.approx(5.0)
    t = np.array([0.0, 2.5, 5.0, 7.5, 10.0, 15.0, 25.0, 30.0, 31.0])
    position, velocity, acceleration = motion.to_and_fro(t, 3)
    np.testing.assert_allclose(position[:, 0], [-1, 0, 1, 0, -1, 1, 1, -1, -1], atol=1e-12)
    np.testing.assert_allclose(velocity[:, 0], [0, 0.5, 0, -0.5, 0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(acceleration[-2:], 0)


@pytest.mark.slow
@pytest.mark.parametrize("elbow", [1, -1])
def test_tip_follows_the_straight_line(elbow):
    motion = line(A, B, 0.1, 0.1)
    t = np.linspace(0, float(motion.duration), 501)
    wanted = motion.at(t)
    assert float(jnp.linalg.norm(wanted.velocity, axis=1).max()) == pytest.approx(0.1)
    assert float(jnp.linalg.norm(wanted.acceleration, axis=1).max()) == pytest.approx(0.1)
    joints = joints_along(ARM, wanted, elbow)
    where = np.asarray(tip(ARM, joints.position))
    across = (B - A)[::-1] * [-1, 1] / np.linalg.norm(B - A)
    np.testing.assert_allclose((where - A) @ across, 0, atol=1e-13)
    np.testing.assert_allclose(where[[0, -1]], [A, B], atol=1e-12)
    speed = jax.vmap(lambda q, w: jax.jvp(lambda q: tip(ARM, q), (q,), (w,))[1])(
        joints.position, joints.velocity
    )
    np.testing.assert_allclose(speed, wanted.velocity, atol=1e-13)
    difference = np.gradient(joints.velocity, t, axis=0)
    inside = np.abs(np.gradient(np.asarray(wanted.acceleration)[:, 0])) == 0
    np.testing.assert_allclose(joints.acceleration[inside], difference[inside], atol=2e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: line(A, A, 0.1, 0.1), "the same"),
        (lambda: joint_motion([0, 1], [0, 1], 1, 1), "the same"),
        (lambda: line(A, B, 0.0, 0.1), "velocity limit above zero"),
        (lambda: joint_motion([0, 1], [1, 1], 1, [1, -1]), "acceleration limit above zero"),
        (lambda: line(A, [0.1, 0.2, 0.3], 0.1, 0.1), "two finite numbers for end"),
        (
            lambda: joints_along(ARM, line(A, [0.9, 0.0], 0.1, 0.1).at(np.linspace(0, 9, 50)), 1),
            "out of reach",
        ),
    ],
)
def test_impossible_motions_are_told(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.slow
def test_slopes_over_the_limits_are_finite_and_right():
    def position(cruise, slope):
        return trapezoid(cruise, slope).position(jnp.linspace(-0.1, 3.0, 12))

    for point in [(0.5, 2.0), (3.0, 1.0)]:
        slopes = jax.jacfwd(position, argnums=(0, 1))(*map(jnp.asarray, point))
        for i, slope in enumerate(slopes):
            step = 1e-6 * np.eye(2)[i]
            difference = (position(*(point + step)) - position(*(point - step))) / 2e-6
            np.testing.assert_allclose(slope, difference, atol=1e-8)
