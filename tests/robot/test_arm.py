"""The arm's dynamics and the whole robot against MuJoCo, and what mechanics says about any arm.

Dry friction at two coupled joints: the nearest point of the box, sticking, the single-joint law.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench, robot
from oracles.robot_bench import PANE, UNEQUAL, card, held, machine
from scipy.optimize import minimize

from jaxmuscle.actuators import Held
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.effects.slip import STICKING_TIME, slip_of_mass
from jaxmuscle.robot.arm import coupled_slip
from jaxmuscle.robot.tondu2000 import robot_arm

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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
