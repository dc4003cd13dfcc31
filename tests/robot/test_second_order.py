"""Second-order identification: exact on a linear system, right on a joint in its linear range."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from scipy.integrate import solve_ivp

from jaxmuscle.components import antagonist
from jaxmuscle.effects import LoadDamping
from jaxmuscle.errors import InputError
from jaxmuscle.robot import SecondOrder, identify, robot_joint

STEP = 2e-3
TRUTHS = [(6.0, 0.3, 1.5e-5), (2.0, 0.9, 1e-5), (6.0, 2.5, 1.5e-5), (15.0, 1.0, -2e-5)]
"""Natural frequency [rad/s], damping ratio, gain [rad/Pa]."""


def step_answer(truth, samples=1500, size=1e5):
    command = np.full(samples, size)
    return command, np.asarray(built(SecondOrder, *truth).response(jnp.asarray(command), STEP))


@pytest.mark.parametrize("truth", TRUTHS)
def test_finds_what_made_the_data(truth):
    found = identify(*step_answer(truth), STEP)
    np.testing.assert_allclose(jax.tree.leaves(found.system), truth, rtol=1e-5)
    assert found.rmse < 1e-8


@pytest.mark.slow
def test_standard_deviations_cover_the_noise():
    errors, stds = [], []
    for seed in range(20):
        command, angle = step_answer(TRUTHS[0], 600)
        noisy = angle + 0.01 * np.random.default_rng(seed).normal(size=600)
        noisy[0] = 0.0
        found = identify(command, noisy, STEP)
        errors.append(np.asarray(jax.tree.leaves(found.system)) - TRUTHS[0])
        stds.append(found.std)
    ratio = np.std(errors, axis=0) / np.mean(stds, axis=0)
    assert (ratio > 0.6).all() and (ratio < 1.6).all()


@pytest.mark.parametrize("truth", TRUTHS)
def test_response_equals_an_ode_solver(truth):
    system = built(SecondOrder, *truth)
    a1, a2, b = map(float, system.coefficients)
    u = lambda t: 1e5 if t < 0.1 else -4e4  # noqa: E731
    command = np.where(np.arange(200) < 50, 1e5, -4e4)
    state, expected = [0.3, -0.2], []
    for k in range(200):
        expected.append(state[0])
        force = u((k + 0.5) * STEP)
        rates = lambda _, y, f=force: [y[1], b * f - a1 * y[1] - a2 * y[0]]  # noqa: E731
        state = solve_ivp(rates, (0, STEP), state, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(system.response(jnp.asarray(command), STEP, 0.3, -0.2), expected, atol=1e-8)


def test_digits_are_kept_where_the_system_is_fast():
    """A command held for 50 to 150 radians, against the closed form of the angle after one sample."""
    for omega, zeta in ((300.0, 0.0), (300.0, 0.1), (3000.0, 0.02)):
        step = 0.05 if omega > 1000 else 0.5
        system = built(SecondOrder, omega, zeta, 2.0)
        found = system.response(jnp.array([3.0, 0.0]), step, 0.1, 5.0)[1]
        decay, turn = np.exp(-zeta * omega * step), omega * np.sqrt(1 - zeta**2)
        off, side = 0.1 - 6.0, (5.0 + zeta * omega * (0.1 - 6.0)) / turn
        exact = 6.0 + decay * (off * np.cos(turn * step) + side * np.sin(turn * step))
        np.testing.assert_allclose(found, exact, rtol=0, atol=6.0 * 2e-16 * omega * step)


@pytest.mark.slow
def test_slopes_of_the_response_equal_finite_differences():
    command = jnp.full(300, 1e5)
    points = jnp.asarray(TRUTHS)
    value = jax.jit(jax.vmap(lambda x: SecondOrder(*x).response(command, STEP)))
    slopes = jax.vmap(jax.jacfwd(lambda x: SecondOrder(*x).response(command, STEP)))(points)
    for i in range(3):
        steps = 1e-6 * np.abs(points[:, i : i + 1]) * np.eye(3)[i]
        difference = (value(points + steps) - value(points - steps)) / 2e-6
        # Rounding of 300 steps over a relative step of 1e-6.
        np.testing.assert_allclose(slopes[:, :, i] * np.abs(points[:, i : i + 1]), difference, atol=2e-7)


def test_joint_without_dry_friction_is_its_linear_model():
    # θ̈ = (2 K1 ΔP - 2 K2 P0 θ - d θ̇)/J for small steps and a quick regulator.
    inertia, damping, mean = 0.0533, 0.2, 2.5e5
    joint = robot_joint(inertia, friction=False).with_effects(
        load_damping=built(LoadDamping, coefficient=damping)
    )
    joint = bench.replace(joint, {"regulator.frequency": 100.0})
    size = 2e3
    pressures = np.tile(bench.AMBIENT + mean + size * np.array([1, -1]), (1500, 1))
    track = bench.track(
        "joint", pressures, pressure=np.full(2, bench.AMBIENT + mean), angle=0.0, angular_velocity=0.0
    )
    angle = bench.simulated(joint, track, 2).readings["angle"]
    found = identify(np.full(1500, size), angle, STEP).system
    k = antagonist.coefficients(joint.muscle, joint.sprocket_radius, joint.initial_contraction)
    stiffness = float(antagonist.stiffness(k, jnp.asarray(mean)))
    omega = np.sqrt(stiffness / inertia)
    # The regulator's lag of 2.7 ms passes for a little damping less.
    assert float(found.natural_frequency) == pytest.approx(omega, rel=0.02)
    assert float(found.damping_ratio) == pytest.approx(damping / (2 * np.sqrt(stiffness * inertia)), rel=0.05)
    assert float(found.gain) == pytest.approx(float(antagonist.static_gain(k, jnp.asarray(mean))), rel=1e-3)


@pytest.mark.parametrize("inertia", [0.64, 0.0533])
def test_joints_of_the_robot_are_second_order_in_open_loop(inertia):
    # [T]: the chain converter - muscle - load can be approximated as a second-order system (figure 17).
    mean, size = 2.5e5, 1e5
    joint = robot_joint(inertia)
    pressures = np.tile(bench.AMBIENT + mean + size * np.array([1, -1]), (1500, 1))
    track = bench.track(
        "joint", pressures, pressure=np.full(2, bench.AMBIENT + mean), angle=0.0, angular_velocity=0.0
    )
    angle = np.asarray(bench.simulated(joint, track, 1).readings["angle"])
    found = identify(np.full(1500, size), angle, STEP)
    assert found.rmse < 0.04 * np.ptp(angle)
    assert float(found.system.damping_ratio) > 0.5


@pytest.mark.parametrize(
    ("command", "angle", "message"),
    [
        (np.ones(5), np.arange(5.0), "ten samples"),
        (np.ones(20), np.arange(21.0), "as many of each"),
        (np.zeros(20), np.arange(20.0), "zero throughout"),
        (np.ones(20), np.zeros(20), "never changes"),
        (np.ones(20), np.append(np.arange(19.0), np.nan), "not finite"),
    ],
)
def test_nothing_to_identify_is_told(command, angle, message):
    with pytest.raises(InputError, match=message):
        identify(command, angle, STEP)
