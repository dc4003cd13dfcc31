"""Static effects against what they stand for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built

from jaxmuscle.effects import (
    BladderHoopStiffness,
    BladderStiffness,
    ChamberLeak,
    Gravity,
    LoadDamping,
    MuscleMismatch,
    PressureDependentEnds,
)
from jaxmuscle.parameters import replace
from jaxmuscle.signals import Signals

MUSCLE = bench.model("driven").muscle
CONTRACTION = jnp.asarray([0.0, 0.02, 0.06])


def pulled(gauge, muscle=MUSCLE):
    force = muscle.force(CONTRACTION, jnp.asarray(gauge), muscle.end_factor)
    return Signals(
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        pressure=jnp.asarray(bench.AMBIENT + gauge),
        gas_temperature=jnp.asarray(293.15),
        muscle=muscle,
        contraction=CONTRACTION,
        muscle_force=force,
    )


@pytest.mark.parametrize("gauge", [0.5e5, 2e5, 5e5])
def test_ends_of_the_reference_muscle(gauge):
    # [T] 10: k(P) = 3.55 exp(-P) + 1.25 with P in bar.
    muscle = replace(MUSCLE, {"end_factor": 1.25})
    signals = pulled(gauge, muscle)
    total = signals.muscle_force + built(PressureDependentEnds, amplitude=3.55).value(signals)
    expected = muscle.force(CONTRACTION, jnp.asarray(gauge), jnp.asarray(3.55 * np.exp(-gauge / 1e5) + 1.25))
    np.testing.assert_allclose(total, expected, rtol=1e-12, atol=1e-9)


def test_ends_leave_the_largest_force_alone():
    assert float(built(PressureDependentEnds, amplitude=3.55).value(pulled(3e5))[0]) == 0


def test_bladder_takes_up_pressure_and_resists_contraction():
    signals = pulled(3e5)
    total = signals.muscle_force + built(BladderStiffness, stiffness=900.0, threshold_pressure=4e4).value(
        signals
    )
    expected = MUSCLE.force(CONTRACTION, jnp.asarray(2.6e5), MUSCLE.end_factor) - 900 * CONTRACTION / 0.3
    np.testing.assert_allclose(total, expected, rtol=1e-12)


def test_stretched_wall_gives_back_its_energy():
    muscle = replace(MUSCLE, {"end_factor": 1.0})

    def energy(contraction):
        swelling = jnp.sqrt(1 - (jnp.cos(muscle.braid_angle) * (1 - contraction / 0.3)) ** 2)
        return 0.5 * 15.0 * 0.3 * (swelling / jnp.sin(muscle.braid_angle) - 1) ** 2

    force = built(BladderHoopStiffness, wall_stiffness=15.0).value(pulled(3e5, muscle))
    np.testing.assert_allclose(force, -jax.vmap(jax.grad(energy))(CONTRACTION), rtol=1e-12, atol=1e-12)


def test_mismatched_muscles_are_muscles_of_their_radii():
    gauge = jnp.asarray([2e5, 3e5])
    contraction = jnp.asarray([0.02, 0.04])
    pair = built(MuscleMismatch, ratio=0.1).altered(MUSCLE)
    single = [replace(MUSCLE, {"initial_radius": r}) for r in (0.007, 0.007 * 1.1)]
    both = list(zip(single, contraction, gauge, strict=True))
    force = [muscle.force(x, p, MUSCLE.end_factor) for muscle, x, p in both]
    np.testing.assert_allclose(pair.force(contraction, gauge, MUSCLE.end_factor), force, rtol=1e-12)
    surface = [muscle.contact_surface(x) for muscle, x, _ in both]
    np.testing.assert_allclose(pair.contact_surface(contraction), surface, rtol=1e-12)


def test_gravity_pulls_towards_hanging_straight_down():
    gravity = built(Gravity, torque=2.0, hanging_angle=0.5)
    torque = [
        float(gravity.value(Signals(position=jnp.asarray(0.5 + a)))) for a in (-np.pi / 2, 0.0, np.pi / 2)
    ]
    np.testing.assert_allclose(torque, [2.0, 0.0, -2.0], atol=1e-12)
    slope = jax.grad(lambda angle: gravity.value(Signals(position=angle)))(jnp.asarray(0.5))
    assert float(slope) == pytest.approx(-2.0)


def test_damping_takes_power_out():
    assert float(built(LoadDamping, coefficient=3.0).value(Signals(velocity=jnp.asarray(-2.0)))) == 6.0


def test_leak_flows_out_under_pressure_and_not_without():
    leak = built(ChamberLeak, area=1e-7)
    assert float(leak.value(pulled(3e5))) < 0 == float(leak.value(pulled(0.0)))
