"""The antagonistic joint in closed form is the two-muscle model; the numbers of [T]."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.actuators import Held
from jaxmuscle.components import McKibben, antagonist
from jaxmuscle.effects import LoadDamping
from jaxmuscle.robot.tondu2000 import robot_joint, robot_muscle

RADIUS, START, MEAN = 0.015, 0.1, 2.5e5
MUSCLE = robot_muscle()
K = antagonist.coefficients(MUSCLE, jnp.asarray(RADIUS), jnp.asarray(START))
DRAWS = np.random.default_rng(7).uniform([1e5, 1e5, -1.5], [4e5, 4e5, 1.5], (30, 3))


def muscles(p1: Any, p2: Any, angle: Any, muscle=MUSCLE, radius: Any = RADIUS, start: Any = START):
    """R (F1 - F2) of two McKibben muscles."""
    middle, k = start * muscle.initial_length, muscle.end_factor
    f1, f2 = muscle.force(middle + radius * angle, p1, k), muscle.force(middle - radius * angle, p2, k)
    return radius * (f1 - f2)


def arrays(*values) -> Any:
    return [jnp.asarray(value) for value in values]


def test_torque_is_that_of_two_muscles():
    for draw in DRAWS:
        ours, theirs = antagonist.torque(K, *arrays(*draw)), muscles(*draw)
        assert float(ours) == pytest.approx(float(theirs), rel=1e-12, abs=1e-12)


@pytest.mark.slow
def test_gradients_are_those_of_two_muscles():
    def closed(values, draw):
        k = antagonist.coefficients(McKibben(*values[:4]), values[4], values[5])
        return antagonist.torque(k, *draw)

    def pair(values, draw):
        return muscles(*draw, muscle=McKibben(*values[:4]), radius=values[4], start=values[5])

    values = jnp.asarray([*map(float, jax.tree.leaves(MUSCLE)), RADIUS, START])
    for draw in jnp.asarray(DRAWS[:6]):
        for ours, theirs in zip(*(jax.grad(f, (0, 1))(values, draw) for f in (closed, pair)), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_the_rig_has_the_same_torque():
    joint = robot_joint(0.05, friction=False)
    for p1, p2, angle in DRAWS[:10]:
        pressure = bench.AMBIENT + jnp.asarray([p1, p2])
        state = {"pressure": pressure, "pressure_rate": jnp.zeros(2)}
        state |= {"angle": jnp.asarray(angle), "angular_velocity": jnp.zeros(())}
        load = joint.signals(state, Held(pressure, None, {})).load
        assert float(load) == pytest.approx(float(antagonist.torque(K, *arrays(p1, p2, angle))), rel=1e-10)


def test_largest_torque_and_range_of_the_robot():
    # [T]: about 7 N m; 7.15 with k = 1.25. The range ε0 l0 / R = 2.07 rad, which the text rounds to 2.2.
    assert float(2 * K.drive * MEAN) == pytest.approx(7.15, abs=0.01)
    assert float(antagonist.joint_range(MUSCLE, *arrays(RADIUS, START))) == pytest.approx(2.07, abs=0.005)


def test_the_quadratic_term_is_about_five_percent_at_the_end_of_the_range():
    # [T]: K3 θ² is negligible against K1, about 5 %.
    end = antagonist.joint_range(MUSCLE, *arrays(RADIUS, START))
    assert float(K.curvature * end**2 / K.drive) == pytest.approx(0.05, abs=0.01)


def test_stiffness_is_the_slope_of_the_torque():
    for p0, dp, angle in [(MEAN, 0.0, 0.0), (MEAN, 8e4, 0.7), (3e5, -1e5, -1.2)]:
        pressures = arrays(p0 + dp, p0 - dp)
        slope = jax.grad(antagonist.torque, 3)(K, *pressures, angle)
        assert float(antagonist.stiffness_at(K, *arrays(p0, dp, angle))) == pytest.approx(-float(slope))
    assert float(antagonist.stiffness(K, jnp.asarray(MEAN))) == pytest.approx(
        float(antagonist.stiffness_at(K, *arrays(MEAN, 0.0, 0.0)))
    )


def test_closed_loop_adds_to_the_natural_stiffness():
    gain = 2e4

    def torque(angle):
        return antagonist.torque(K, MEAN - gain * angle, MEAN + gain * angle, angle)

    assert float(antagonist.stiffness_in_closed_loop(K, *arrays(MEAN, gain))) == pytest.approx(
        -float(jax.grad(torque)(0.0))
    )


@pytest.mark.parametrize("difference", [-1.2e5, -1e3, 0.0, 1e3, 5e4, 1.2e5])
def test_torque_vanishes_at_the_equilibrium(difference):
    angle = antagonist.equilibrium_angle(K, *arrays(MEAN, difference))
    assert float(muscles(MEAN + difference, MEAN - difference, angle)) == pytest.approx(0, abs=1e-12)


def test_hogans_form_is_that_of_the_muscles_without_the_quadratic_term():
    largest = 5e5
    straight = K._replace(curvature=jnp.zeros(()))
    rng = np.random.default_rng(2)
    for biceps, triceps, angle in rng.uniform([0, 0, -1], 1, size=(6, 3)):
        ours = antagonist.torque(straight, biceps * largest, triceps * largest, angle)
        hogans = antagonist.biceps_triceps_torque(
            K.drive * largest, K.restoring * largest, biceps, triceps, angle
        )
        assert float(ours) == pytest.approx(float(hogans), rel=1e-12, abs=1e-12)


def test_static_gain_is_the_slope_of_the_equilibrium():
    slope = jax.grad(antagonist.equilibrium_angle, 2)(K, *arrays(MEAN, 0.0))
    assert float(antagonist.static_gain(K, jnp.asarray(MEAN))) == pytest.approx(float(slope), rel=1e-12)


def test_the_rig_comes_to_the_equilibrium():
    joint = robot_joint(0.05, friction=False).with_effects(
        load_damping=bench.built(LoadDamping, coefficient=1.0)
    )
    target = np.tile(bench.AMBIENT + MEAN + 5e4 * np.array([1, -1]), (4000, 1))
    track = bench.track(
        "joint", target, pressure=np.full(2, bench.AMBIENT + MEAN), angle=0.0, angular_velocity=0.0
    )
    angle = bench.simulated(joint, track, 1).readings["angle"]
    expected = antagonist.equilibrium_angle(K, *arrays(MEAN, 5e4))
    assert float(angle[-1]) == pytest.approx(float(expected), rel=1e-6)


def test_pressure_difference_undoes_the_torque():
    for p0, angle, torque in [(MEAN, 0.4, 1.2), (2e5, -1.0, 0.0), (MEAN, 0.0, 3.0)]:
        difference = antagonist.pressure_difference(K, *arrays(p0, angle, torque))
        assert float(muscles(p0 + difference, p0 - difference, jnp.asarray(angle))) == pytest.approx(
            torque, abs=1e-12
        )
