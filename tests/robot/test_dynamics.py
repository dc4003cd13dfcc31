"""The arm's dynamics and the whole robot against MuJoCo, and what mechanics says about any arm."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench, robot
from oracles.robot_bench import PANE, UNEQUAL, card, held, machine

from jaxmuscle.actuators import Held
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.robot.reference import robot_arm

ARM = machine(UNEQUAL).arm
RNG = np.random.default_rng(1)
WIDE = {"initial_contraction": 0.2}
"""Joints that end beyond 4 rad: the ones of MuJoCo have no end."""
STATES = RNG.uniform(-3, 3, (20, 3, 2))
"""Angles, velocities and torques."""


@pytest.mark.parametrize("changes", [{}, UNEQUAL], ids=["published", "unequal"])
def test_acceleration_equals_mujoco(changes):
    actuator = machine(changes)
    expected = [robot.acceleration(card(actuator), *state) for state in STATES]
    ours = actuator.arm.acceleration(*jnp.asarray(STATES).swapaxes(0, 1))
    np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("changes", [{}, UNEQUAL], ids=["published", "unequal"])
def test_vector_field_equals_mujoco_at_random_states(changes):
    actuator = machine({**changes, **WIDE, **PANE, "pane.distance": 0.3})
    numbers = card(actuator)
    touching = 0
    for angle, velocity, draw in STATES:
        gauge = 2.5e5 + 0.8e5 * np.append(draw, draw[::-1])
        pressure = jnp.asarray(bench.AMBIENT + gauge)
        state = {"pressure": pressure, "pressure_rate": jnp.zeros(4)}
        state |= {"angle": jnp.asarray(angle), "angular_velocity": jnp.asarray(velocity), "effects": {}}
        ours = actuator.vector_field(state, Held(pressure, None, {}))["angular_velocity"]
        torque = [
            robot.joint_torque(numbers, gauge[2 * j : 2 * j + 2], angle[j], velocity[j]) for j in (0, 1)
        ]
        contact = robot.contact_torque(numbers, angle, velocity)
        touching += bool(np.abs(contact).max() > 0)
        expected = robot.acceleration(numbers, angle, velocity, torque + contact)
        np.testing.assert_allclose(ours, expected, rtol=1e-7, atol=1e-7)
    assert 0 < touching < len(STATES)


CASES = {
    "free": ({}, False),
    "loaded and tilted": (UNEQUAL, False),
    "into the pane": ({"arm.payload": 0.5, **PANE}, False),
    "with friction": ({}, True),
}


@pytest.mark.parametrize("case", CASES)
def test_run_equals_mujoco(case):
    changes, friction = CASES[case]
    actuator = machine(changes if friction else {**changes, **WIDE}, friction)
    end = joint_range(actuator.muscle, actuator.sprocket_radius, actuator.initial_contraction)
    first, then, angle = [2.5e5] * 4, [3.9e5, 1.1e5, 1.4e5, 3.6e5], [0.2, 0.4]
    if case == "into the pane":
        angle = [0.2, 1.2]
    samples, substeps = 300, 16
    track = held(first, then, angle, samples)
    ours = bench.simulated(actuator, track, substeps, ("angular_velocity",))
    every, step = (40, 5e-5) if friction else (4, 5e-4)
    reference = robot.run(card(actuator), first, then, angle, samples, every, step)
    assert np.ptp(reference[:, :2], axis=0).min() > 0.1 and np.abs(reference[:, :2]).max() < end
    if "pane.stiffness" in changes:
        depth = actuator.pane.penetration(
            jnp.asarray([robot.tip(card(actuator), q)[0] for q in reference[:, :2]])
        )
        assert float(depth.max()) > 2e-3 and float(depth[0]) < 0
    for values, expected in (
        (ours.readings["angle"], reference[:, :2]),
        (ours.states.state["angular_velocity"], reference[:, 2:]),
    ):
        # Of the range: what 16 steps a sample leave; friction: the oracle's creep while stuck, 1.3 mrad/s.
        assert bench.deviation(values, expected) < (2e-3 if friction else 2e-6)


def test_energy_is_kept_without_torque():
    angle, velocity, _ = jnp.asarray(STATES).swapaxes(0, 1)
    acceleration = ARM.acceleration(angle, velocity, jnp.zeros_like(angle))
    _, power = jax.jvp(ARM.energy, (angle, velocity), (velocity, acceleration))
    np.testing.assert_allclose(power, 0, atol=1e-11)


def test_equations_of_motion_are_those_of_lagrange():
    def lagrangian(angle, velocity):
        return (
            2 * ARM.energy(angle, velocity)
            - ARM.energy(angle, velocity)
            - 2 * ARM.energy(angle, 0 * velocity)
        )

    def torque(angle, velocity, acceleration):
        momentum = jax.grad(lagrangian, argnums=1)
        change = jax.jvp(momentum, (angle, velocity), (velocity, acceleration))[1]
        return change - jax.grad(lagrangian)(angle, velocity)

    states = jnp.asarray(STATES).swapaxes(0, 1)
    np.testing.assert_allclose(ARM.torque(*states), jax.vmap(torque)(*states), rtol=1e-10, atol=1e-10)


def test_inverse_undoes_forward_dynamics():
    angle, velocity, torque = jnp.asarray(STATES).swapaxes(0, 1)
    acceleration = ARM.acceleration(angle, velocity, torque)
    np.testing.assert_allclose(ARM.torque(angle, velocity, acceleration), torque, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(("load", "joint_1", "joint_2"), [(0.5, 0.5, 1.5), (1.0, 1.0, 3.0), (1.5, 1.5, 4.5)])
def test_loads_add_the_published_inertia(load, joint_1, joint_2):
    # [T], robustness test; largest inertia of joint 1: arm stretched.
    stretched = jnp.zeros(2)
    before, after = (np.diag(robot_arm(m).mass_matrix(stretched)) for m in (0.0, load))
    np.testing.assert_allclose(after / before - 1, [joint_1, joint_2], rtol=1e-12)


def test_links_have_the_published_weight():
    arm = robot_arm()
    assert float(arm.second.mass) == pytest.approx(0.6)
    assert 1.5 / float(arm.first.mass + arm.second.mass) == pytest.approx(0.30)
