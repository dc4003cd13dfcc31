"""Dry friction: sticking, sliding, what it does to energy, and the coefficients of [T]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.actuators import Held
from jaxmuscle.effects import LoadFriction, ThreadFriction
from jaxmuscle.effects.slip import slip_of_mass, slip_of_velocity
from jaxmuscle.parameters import replace
from jaxmuscle.signals import Signals

BENT = bench.model("joint", load_friction={"force": 1.0})


def slip(driving, momentum, limit):
    return slip_of_mass(jnp.asarray(driving), jnp.asarray(momentum), jnp.asarray(limit))


@pytest.mark.parametrize("share", [-1.0, -0.9, 0.0, 0.5, 1.0])
def test_sticking_friction_balances_the_driving_force(share):
    assert float(slip(share * 20.0, 0.0, 20.0)) == pytest.approx(share)


@pytest.mark.parametrize("momentum", [0.5, -0.5])
def test_sliding_friction_is_at_its_limit_against_the_motion(momentum):
    assert float(slip(5.0, momentum, 20.0)) == np.sign(momentum)


@pytest.mark.parametrize(("driving", "expected"), [(3.0, 1.0), (-3.0, -1.0), (0.0, 0.0)])
def test_zero_limit_keeps_the_sign(driving, expected):
    assert float(slip(driving, 0.0, 0.0)) == expected


def test_slope_over_a_zero_limit_is_that_of_sliding():
    def acceleration(limit):
        return 7.0 - limit * slip(7.0, 0.3, limit)

    assert float(jax.grad(acceleration)(jnp.asarray(0.0))) == -1.0
    assert float(acceleration(jnp.asarray(1e-3)) - acceleration(jnp.asarray(0.0))) == pytest.approx(-1e-3)


@pytest.mark.parametrize("limit", [0.0, 20.0])
@pytest.mark.parametrize("momentum", [0.0, 1e-3, -1e-3])
@pytest.mark.parametrize("driving", [0.0, 20.0, -30.0])
def test_slopes_are_finite(driving, momentum, limit):
    slopes = jax.grad(slip_of_mass, argnums=(0, 1, 2))(*map(jnp.asarray, (driving, momentum, limit)))
    assert np.isfinite(slopes).all()


def pressures_for(torque):
    """Gauge pressures about 2.5 bar that turn the bare joint at angle 0 with the given torque."""

    def load(difference):
        pressure = bench.AMBIENT + 2.5e5 + difference * jnp.array([1.0, -1.0])
        state = {"pressure": pressure, "pressure_rate": jnp.zeros(2), "angle": jnp.zeros(())}
        state["angular_velocity"] = jnp.zeros(())
        return bench.model("joint").signals(state, Held(pressure, None, {})).load

    difference = torque / load(1.0)
    return np.asarray(bench.AMBIENT + 2.5e5 + difference * jnp.array([1.0, -1.0]))


def angle_under(torque, seconds=10.0, substeps=1, velocity=0.0):
    pressure = pressures_for(torque)
    samples = round(seconds / bench.STEPS["joint"])
    track = bench.track(
        "joint", np.tile(pressure, (samples, 1)), pressure=pressure, angle=0.0, angular_velocity=velocity
    )
    return np.asarray(bench.simulated(BENT, track, substeps).readings["angle"])


@pytest.mark.parametrize("share", [0.9, -0.9])
def test_does_not_creep_for_ten_seconds_below_the_limit(share):
    assert np.abs(angle_under(share)).max() < 1e-12


def test_comes_to_rest_and_stays_there():
    angle = angle_under(0.5, velocity=1.0)
    assert angle.max() > 1e-3
    assert np.ptp(angle[2500:]) < 1e-12


def test_slides_with_the_excess_over_the_limit():
    angle = angle_under(1.5, seconds=0.02, substeps=8)
    time = np.arange(len(angle)) * bench.STEPS["joint"]
    expected = 0.5 * (1.5 - 1.0) / float(BENT.inertia) * time**2
    # The stiffness of the muscles takes its share of the torque as the joint turns: 1 % after 20 ms.
    np.testing.assert_allclose(angle[1:], expected[1:], rtol=0.02)


def test_stops_after_the_distance_that_eats_the_kinetic_energy():
    actuator = replace(BENT, {"effects.load_friction.force": 2.0, "muscle.initial_radius": 1e-6})
    track = bench.track(
        "joint",
        np.full((300, 2), bench.AMBIENT),
        pressure=np.full(2, bench.AMBIENT),
        angle=0.0,
        angular_velocity=10.0,
    )
    angle = bench.simulated(actuator, track, 4).readings["angle"]
    assert float(angle[-1]) == pytest.approx(0.5 * float(actuator.inertia) * 10.0**2 / 2.0, rel=1e-3)


def test_slip_of_an_imposed_velocity():
    velocity = jnp.array([-0.01, -1e-3, 0.0, 1e-3, 0.01])
    np.testing.assert_allclose(slip_of_velocity(velocity), np.sign(velocity), atol=1e-8)
    assert np.isfinite(jax.vmap(jax.grad(slip_of_velocity))(velocity)).all()


def thread_situation(strain, velocity, gauge=3e5):
    muscle = bench.model("driven").muscle
    return Signals(
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        pressure=jnp.asarray(bench.AMBIENT + gauge),
        muscle=muscle,
        contraction=jnp.asarray(strain) * muscle.initial_length,
        contraction_velocity=jnp.asarray(velocity),
        velocity=jnp.asarray(velocity),
    )


def test_thread_friction_goes_from_static_to_kinetic():
    friction = built(ThreadFriction, **bench.THREADS)
    still, slow, fast = (float(friction.limit(thread_situation(0.1, v))) for v in (0.0, 0.15, 1e3))
    assert fast / still == pytest.approx(7.0)
    assert (slow - fast) / (still - fast) == pytest.approx(np.exp(-1))
    assert float(friction.limit(thread_situation(0.1, -0.15))) == slow


def test_thread_friction_at_rest_is_surface_times_pressure():
    # [T] 11: f S P, S = 2π r0 l0 at ε = 0.
    friction = built(ThreadFriction, **bench.THREADS)
    expected = 0.015 * 2 * np.pi * 0.007 * 0.3 * 3e5
    assert float(friction.limit(thread_situation(0.0, 0.0))) == pytest.approx(expected)


def test_thread_friction_is_gone_without_pressure():
    assert float(built(ThreadFriction, **bench.THREADS).limit(thread_situation(0.1, 0.2, gauge=-1e3))) == 0


def test_slope_of_the_thread_friction_at_reversal_is_finite():
    def limit(velocity):
        return built(ThreadFriction, **bench.THREADS).limit(thread_situation(0.1, velocity))

    slopes = jax.vmap(jax.grad(limit))(jnp.array([-1e-9, 0.0, 1e-9]))
    assert np.isfinite(slopes).all()
    assert float(slopes[0]) == pytest.approx(-float(slopes[2]))


def test_load_friction_is_constant():
    friction = built(LoadFriction, force=16.0)
    assert (
        float(friction.limit(thread_situation(0.1, 0.0)))
        == float(friction.limit(thread_situation(0.2, 3.0)))
        == 16
    )
