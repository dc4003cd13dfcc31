"""Dry friction on bristles: springs while stuck, the law without bristles in the limit, stable in between."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from effects.test_friction import pressures_for
from oracles import bench

from jaxmuscle.effects.slip import DAMPING_TIME, Bristle, slip_of_mass
from jaxmuscle.parameters import get, replace
from jaxmuscle.robot.arm import coupled_slip

LIMIT = 1.0
REST, UNIT = pressures_for(0.0), pressures_for(1.0) - pressures_for(0.0)
"""Pressures of the bare joint at angle 0 without a torque, and what each newton metre adds."""
STEP = bench.STEPS["joint"]
DISTANCES = (0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)


def joint(distance, **more):
    return bench.model("joint", load_friction={"force": LIMIT}, presliding={"distance": distance, **more})


def turned(torques, distance, substeps=1, **more):
    """Angle of a joint under torques, one a sample, from rest at 0."""
    command = REST + torques[:, None] * UNIT
    track = bench.track("joint", command, pressure=command[0], angle=0.0, angular_velocity=0.0)
    return np.asarray(bench.simulated(joint(distance, **more), track, substeps).readings["angle"])


def stiffness(machine):
    """Of the muscles about angle 0, under the pressures of a torque of nearly none [N m/rad]."""
    pressure = jnp.asarray(REST)
    muscle, r = machine.muscle, machine.sprocket_radius
    middle = machine.initial_contraction * muscle.initial_length

    def torque(angle):
        contraction = middle + r * angle * jnp.array([1.0, -1.0])
        force = muscle.force(contraction, pressure - bench.AMBIENT, muscle.end_factor)
        return r * (force[0] - force[1])

    return -float(jax.grad(torque)(0.0))


def test_rests_where_bristles_and_muscles_balance_the_torque():
    distance, torque = 0.01, 0.5
    slowly = torque * np.sin(0.5 * np.pi * np.minimum(np.arange(2250) / 1500, 1.0)) ** 2
    angle = turned(slowly, distance)[-1]
    machine = joint(distance)
    # Virgin curve z = 1 - exp(-x/δ): the muscles' own stiffness takes its part.
    left = torque - stiffness(machine) * angle - LIMIT * (1 - np.exp(-angle / distance))
    assert abs(left) < 2e-3
    assert 0.3 * distance < angle < distance


def test_does_not_creep_under_a_constant_torque():
    angle = turned(np.full(5000, 0.5), 0.01)
    assert np.ptp(angle[3000:]) < 1e-12


@pytest.mark.parametrize("distance", DISTANCES)
def test_is_stable_whatever_the_distance(distance):
    steady = np.full(250, 0.6)
    waves = 0.9 * np.sin(2 * np.pi * 3 * np.arange(500) * STEP)
    angle = turned(np.concatenate([steady, waves, np.zeros(2250)]), distance)
    assert np.isfinite(angle).all()
    assert np.abs(angle).max() < 5 * distance + 1e-9
    # It has come to rest again.
    assert np.ptp(angle[-250:]) < 1e-3 * distance + 1e-12


def test_small_distances_approach_the_law_without_bristles():
    torque = 1.8 * np.sin(2 * np.pi * 2 * np.arange(400) * STEP)
    rigid = turned(torque, 0.0, 4)
    gaps = [np.abs(turned(torque, distance, 4) - rigid).max() for distance in (1e-3, 1e-4, 1e-5)]
    assert np.ptp(rigid) > 0.01
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 1e-3 * np.ptp(rigid)


def test_without_a_distance_it_is_the_law_without_bristles_to_the_last_bit():
    rng = np.random.default_rng(0)
    for _ in range(20):
        driving, momentum, limit = map(jnp.asarray, rng.normal(size=3) * [3, 1e-3, 1])
        limit = jnp.maximum(limit, 0.0)
        bristle = Bristle(jnp.asarray(rng.uniform(-1, 1)), jnp.asarray(0.0))
        assert slip_of_mass(driving, momentum, limit, None, bristle, 0.04) == slip_of_mass(
            driving, momentum, limit
        )


@pytest.mark.parametrize("damping_time", [2e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("distance", DISTANCES[1:])
def test_a_pushed_joint_stays_on_its_bristles(distance, damping_time):
    """However stiff and however little damped they are, at steps of a sample."""
    torques = 0.5 * LIMIT * np.minimum(np.arange(1000) / 500, 1.0)
    angle = turned(torques, distance, damping_time=damping_time)
    rest = distance * np.log(2.0)  # where the bristles carry half of the limit
    assert angle.max() < 1.3 * rest and angle[-1] == pytest.approx(rest, rel=0.2)


@pytest.mark.parametrize("damping_time", [1e-3, 4e-3])
def test_damping_of_soft_bristles_is_the_time_times_their_stiffness(damping_time):
    mass, distance, limit = 0.04, 10.0, jnp.asarray(LIMIT)

    def friction(velocity):
        bristle = Bristle(jnp.asarray(0.0), jnp.asarray(distance), damping_time)
        return limit * slip_of_mass(jnp.asarray(0.0), mass * velocity, limit, None, bristle, mass)

    slope = jax.grad(friction)(jnp.asarray(1e-3))
    assert float(slope) == pytest.approx(damping_time * LIMIT / distance, rel=1e-3)


def test_slip_is_the_share_where_nothing_moves_fast():
    # In balance the driving force is L z, and friction takes all of it.
    for distance in (1e-6, 1e-3):
        bristle = Bristle(jnp.asarray(0.4), jnp.asarray(distance))
        driving, limit = jnp.asarray(0.4 * LIMIT), jnp.asarray(LIMIT)
        slip = slip_of_mass(driving, jnp.asarray(0.0), limit, None, bristle, 0.04)
        assert float(slip) == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize("momentum", [0.0, 1e-4, -1e-4])
@pytest.mark.parametrize("distance", [0.0, 1e-5, 1e-3])
def test_slopes_of_the_slip_equal_differences(distance, momentum):
    def slip(values):
        driving, momentum, limit, distance, share = values
        return slip_of_mass(driving, momentum, limit, None, Bristle(share, distance), 0.04)

    at = jnp.array([0.3, momentum, 1.0, distance, 0.2])
    size = jnp.array([1.0, 1e-3, 1.0, 1e-3, 1.0])
    slope = jax.vmap(jax.grad(slip))(at[None])[0] * size
    h = 1e-6 * jnp.diag(size)
    # One-sided, second order: a distance has no other side at zero.
    difference = [(4 * slip(at + d / 2) - slip(at + d) - 3 * slip(at)) / 1e-6 for d in h]
    np.testing.assert_allclose(slope, jnp.stack(difference), rtol=1e-5, atol=1e-7)


@pytest.mark.slow
def test_runs_have_slopes_over_the_distance():
    torque = 1.5 * np.sin(2 * np.pi * 3 * np.arange(150) * STEP)
    command = REST + torque[:, None] * UNIT
    track = bench.track("joint", command, pressure=command[0], angle=0.0, angular_velocity=0.0)
    path = "effects.presliding.distance"

    def angle(distance):
        return bench.simulate(replace(joint(0.0), {path: distance}), track, 1).readings["angle"]

    assert float(get(joint(0.0), path)) == 0.0
    at = jnp.array([0.0, 2e-3, 2e-2])
    slopes = jax.jit(jax.vmap(jax.jacfwd(angle)))(at)
    assert np.isfinite(slopes).all()
    run = jax.jit(jax.vmap(angle))
    difference = (run(at[1:] + 1e-7) - run(at[1:] - 1e-7)) / 2e-7
    np.testing.assert_allclose(slopes[1:], difference, rtol=1e-3, atol=1e-4 * np.abs(slopes[1:]).max())


def test_pulled_at_a_steady_pace_friction_builds_up_along_dahl():
    distance, pace = 2e-3, 0.02
    model = bench.model(
        "driven", thread_friction={"static_coefficient": 0.05, "kinetic_coefficient": 0.05},
        presliding={"distance": distance},
    )  # fmt: skip
    way = pace * np.arange(100) * bench.STEPS["driven"]
    motion = np.full(100, bench.AMBIENT + 2.5e5), 0.02 + way, np.full(100, pace)

    def force(machine):
        return np.asarray(bench.simulated(machine, bench.driven_track(*motion), 1).readings["force"])

    bare = model.without_effects("presliding", "thread_friction")
    limit = force(bare) - force(model.without_effects("presliding"))
    share = (force(bare) - force(model)) / limit
    left = np.exp(-way / distance)
    np.testing.assert_allclose(share, 1 - left + DAMPING_TIME * pace / distance * left, atol=1e-9)


def test_two_joints_that_do_not_feel_each_other_are_two_masses():
    mass = jnp.array([0.04, 0.007])
    bristle = Bristle(jnp.array([0.3, -0.5]), jnp.asarray(1e-3))
    driving, velocity = jnp.array([0.7, -0.2]), jnp.array([1e-3, 2e-3])
    limit = jnp.array([1.0, 0.4])
    slip = coupled_slip(driving, velocity, limit, jnp.diag(mass), None, None, bristle)
    each = []
    for i in range(2):
        own = Bristle(bristle.share[i], bristle.distance)
        each.append(slip_of_mass(driving[i], mass[i] * velocity[i], limit[i], None, own, mass[i]))
    np.testing.assert_allclose(slip, jnp.stack(each), rtol=1e-9)


def test_two_coupled_joints_in_balance_stay_there():
    matrix = jnp.array([[0.05, 0.02], [0.02, 0.03]])
    limit, share = jnp.array([1.0, 0.4]), jnp.array([0.3, -0.5])
    for distance in (0.0, 1e-5, 1e-3):
        slip = coupled_slip(
            limit * share, jnp.zeros(2), limit, matrix, None, None, Bristle(share, jnp.asarray(distance))
        )
        np.testing.assert_allclose(slip, share, rtol=1e-9)
    without = coupled_slip(limit * share, jnp.zeros(2), limit, matrix)
    np.testing.assert_array_equal(
        without,
        coupled_slip(
            limit * share, jnp.zeros(2), limit, matrix, None, None, Bristle(share, jnp.asarray(0.0))
        ),
    )


@pytest.mark.slow
def test_slopes_of_coupled_joints_are_finite():
    matrix = jnp.array([[0.05, 0.02], [0.02, 0.03]])

    def slip(limit, distance, share):
        bristle = Bristle(share, distance)
        return coupled_slip(jnp.array([0.3, 0.1]), jnp.zeros(2), limit, matrix, None, None, bristle)

    for limit in (jnp.zeros(2), jnp.array([1.0, 0.0]), jnp.ones(2)):
        for distance in (0.0, 1e-4):
            slopes = jax.jacfwd(slip, argnums=(0, 1, 2))(limit, jnp.asarray(distance), jnp.array([0.1, 0.0]))
            assert all(np.isfinite(slope).all() for slope in slopes)
