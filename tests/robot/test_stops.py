"""Ends of coupled joints: resistance, friction beside it, impact, and the robot against its ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.robot_bench import held, machine
from scipy.optimize import minimize

from jaxmuscle import simulate
from jaxmuscle.actuators import Held
from jaxmuscle.analysis import equilibrium
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.robot.arm import between_stops, coupled_slip, stop_torque
from jaxmuscle.robot.tondu2000 import robot_arm

MATRIX = robot_arm(0.5).mass_matrix(jnp.array([0.0, 0.7]))
MASS = np.asarray(MATRIX)
ENDS = jnp.asarray(-2.0), jnp.asarray(2.0)
END = 0.1 * 0.31 / 0.015
DRAWS = np.random.default_rng(8).normal(size=(12, 2))
CORNERS = [([False, False], [True, False]), ([True, False], [False, True]), ([False, True], [True, False])]


def nearest(wanted, low, high):
    """The point of a box nearest to `wanted` in the norm of the inverse mass matrix, by SciPy."""
    inverse = np.linalg.inv(MASS)
    begin = np.clip(wanted, low, high)
    cost = lambda f: (wanted - f) @ inverse @ (wanted - f)  # noqa: E731
    return minimize(cost, begin, bounds=list(zip(low, high, strict=True)), tol=1e-15).x


@pytest.mark.parametrize("stops", CORNERS)
@pytest.mark.parametrize("limit", [(0.0, 0.0), (0.4, 0.1)])
def test_resistance_and_friction_are_the_nearest_point_of_the_box(stops, limit):
    lower, upper = np.asarray(stops)
    arrays = jnp.asarray(lower), jnp.asarray(upper)
    low, high = np.where(lower, -np.inf, -np.asarray(limit)), np.where(upper, np.inf, limit)
    for torque in DRAWS:
        expected = nearest(torque, low, high)
        if limit == (0.0, 0.0):
            found = np.asarray(stop_torque(jnp.asarray(torque), arrays, MATRIX))
            np.testing.assert_allclose(found, expected, atol=1e-6)
            motion = np.linalg.solve(MASS, torque - found)
            # Complementarity: no motion outwards, no resistance to a joint that moves inwards.
            assert (motion[upper] < 1e-12).all() and (motion[lower] > -1e-12).all()
            assert np.abs(motion * found).max() < 1e-12
        else:
            slip = coupled_slip(jnp.asarray(torque), jnp.zeros(2), jnp.asarray(limit), MATRIX, None, arrays)
            np.testing.assert_allclose(slip, np.clip(expected / limit, -1, 1), atol=1e-5)


@pytest.mark.parametrize(("lower", "upper"), CORNERS)
def test_impact_takes_away_the_least_and_keeps_the_momentum_of_the_other_joint(lower, upper):
    angle = np.where(lower, -2.0, np.where(upper, 2.0, 0.3))
    for velocity in DRAWS:
        at, after = between_stops(jnp.asarray(angle), jnp.asarray(velocity), *ENDS, MATRIX)
        np.testing.assert_array_equal(at, angle)
        low, high = np.where(lower, -np.inf, 0.0), np.where(upper, np.inf, 0.0)
        expected = velocity - np.linalg.solve(MASS, nearest(MASS @ velocity, low, high))
        np.testing.assert_allclose(after, expected, atol=1e-6)
        assert after @ MASS @ after <= velocity @ MASS @ velocity + 1e-12
        free = ~(np.asarray(lower) | np.asarray(upper))
        np.testing.assert_allclose((MASS @ after)[free], (MASS @ velocity)[free], atol=1e-12)


def test_within_the_stops_nothing_happens():
    for velocity in DRAWS:
        at, after = between_stops(jnp.array([0.4, -1.0]), jnp.asarray(velocity), *ENDS, MATRIX)
        np.testing.assert_array_equal(at, [0.4, -1.0])
        np.testing.assert_array_equal(after, velocity)


def test_other_joint_moves_as_if_the_one_at_its_end_were_part_of_the_base():
    actuator = machine({"arm.payload": 0.5}, friction=False)
    pressure = jnp.asarray(bench.AMBIENT + np.array([4.6e5, 0.4e5, 3e5, 2e5]))
    state = {"pressure": pressure, "pressure_rate": jnp.zeros(4), "effects": {}}
    state |= {"angle": jnp.array([END, 0.2]), "angular_velocity": jnp.array([0.0, 1.5])}
    rates = actuator.vector_field(state, Held(pressure, None, {}))["angular_velocity"]
    torque = actuator.signals(state, Held(pressure, None, {})).load
    matrix = actuator.arm.mass_matrix(state["angle"])
    bias = actuator.arm.bias(state["angle"], state["angular_velocity"])
    assert float(torque[0]) > 0.1
    np.testing.assert_allclose(rates, [0.0, (torque[1] - bias[1]) / matrix[1, 1]], rtol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(2.5e5, 2.2e5), (2.5e5, -2.5e5), (2e6, 1e6)])
def test_robot_ends_where_muscles_are_at_their_full_length(first, second):
    times, mean = np.arange(1000) * 2e-3, bench.AMBIENT + 2.5e5
    command = np.tile(mean + np.array([first, -first, second, -second]), (1000, 1))
    angle = np.asarray(
        simulate(machine(), command, times, start={"pressure": np.full(4, mean)}).readings["angle"]
    )
    assert np.isfinite(angle).all() and np.abs(angle).max() <= END * (1 + 1e-12)
    np.testing.assert_allclose(angle[-20:], np.tile([END, np.sign(second) * END], (20, 1)), rtol=1e-12)


@pytest.mark.slow
def test_rests_at_the_end_of_one_joint():
    actuator = machine({"arm.payload": 0.5}, friction=False).with_effects(
        load_damping=bench.built(bench.BY_NAME["load_damping"], coefficient=0.4)
    )
    mean = bench.AMBIENT + 2.5e5
    point = equilibrium(
        actuator, mean + np.array([2.4e5, -2.4e5, 5e4, -5e4]), start={"pressure": np.full(4, mean)}
    )
    assert point.converged
    np.testing.assert_allclose(point.readings[4], END, rtol=1e-9)
    assert 0.5 < float(point.readings[5]) < 1.0


@pytest.mark.parametrize("velocity", [[4e-132, -4e-24], [-1e-20, 0.3], [1e-20, -0.3]])
def test_rounding_does_not_lift_a_joint_off_its_end(velocity):
    actuator = machine({"arm.payload": 0.5}, friction=False)
    state = {"angle": jnp.array([END, 0.7]), "angular_velocity": jnp.array(velocity)}
    rest = actuator.constrained({"pressure": jnp.full(4, 3e5), **state})["angular_velocity"]
    assert float(rest[0]) == 0.0
    np.testing.assert_allclose(rest[1], velocity[1], rtol=0, atol=1e-12)


@pytest.mark.slow
def test_slopes_at_the_ends_equal_finite_differences():
    actuator = machine({"arm.payload": 0.5}, friction=False)
    scenes = [
        held([4.7e5, 0.3e5, 2.5e5, 2.5e5], [4.7e5, 0.3e5, 3e5, 2e5], [2.0, 0.3], 40, [4.0, 1.0]),
        held([4.7e5, 0.3e5, 4.7e5, 0.3e5], [4.7e5, 0.3e5, 0.3e5, 4.7e5], [2.0, 2.0], 40, [4.0, 8.0]),
    ]
    tracks = jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)
    paths = [p for p in parameters(actuator) if p.startswith(("arm.", "muscle.", "sprocket", "initial"))]
    values = np.array([float(parameters(actuator)[path].value) for path in paths])

    def angles(values, track):
        return bench.simulate(replace(actuator, dict(zip(paths, values, strict=True))), track, 1).readings[
            "angle"
        ]

    run = jax.jit(jax.vmap(angles, (None, 0)))
    slopes = np.asarray(jax.jit(jax.vmap(jax.jacfwd(angles), (None, 0)))(values, tracks))
    weights = np.random.default_rng(0).normal(size=(40, 2))
    back = jax.jit(jax.vmap(jax.grad(lambda v, t: (weights * angles(v, t)).sum()), (None, 0)))(values, tracks)
    at = np.abs(np.abs(np.asarray(run(values, tracks))) - END) < 1e-12
    assert at[0, :, 0].sum() > 20 and at[1, :, 1].any() and not at[1, -1, 1]
    for j in range(len(values)):
        h = 1e-7 * max(abs(values[j]), 0.1)
        step = np.eye(len(values))[j] * h
        difference = np.asarray(run(values + step, tracks) - run(values - step, tracks)) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], difference, rtol=1e-4, atol=1e-4, err_msg=paths[j])
    np.testing.assert_allclose(back, np.einsum("tq,stqj->sj", weights, slopes), rtol=1e-8, atol=1e-8)
