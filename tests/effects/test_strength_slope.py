"""The slope of every effect over its strength at zero: finite, and equal to one-sided differences."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.effects import (
    CATALOGUE,
    FURTHER,
    AbstractMemoryEffect,
    AbstractRateEffect,
    AbstractStaticEffect,
)
from jaxmuscle.effects.base import (
    AbstractFrictionEffect,
    AbstractMuscleEffect,
    AbstractSlipEffect,
    AbstractTransmissionEffect,
)
from jaxmuscle.effects.slip import Bristle, slip_of_mass
from jaxmuscle.signals import Past, Signals

NOISE = np.random.default_rng(7).normal(0, 0.1, 32)
SIZES = {
    "area": 1e-7,
    "delay": 1e-3,
    "stiffness": 100.0,
    "time_constant": 5e-3,
    "wall_stiffness": 10.0,
    "inverse_rate": 1e-8,
    "resistance": 1e7,
    "volume": 1e-5,
    "thickness": 1e-3,
    "compliance": 1e-5,
    "distance": 1e-4,
    "half_width": 1e-3,
    "cubic": 1e-6,
}
ALL = pytest.mark.parametrize("effect_type", (*CATALOGUE, *FURTHER), ids=lambda effect: effect.__name__)
VELOCITIES = (0.13, 0.0, -0.13)


@functools.cache
def situation(velocity, contraction):
    """Signals of a pair of muscles in the middle of its run: what any of the effects may read."""
    both = jnp.array([1.0, -1.0])
    pressure = bench.AMBIENT + jnp.array([3.1e5, 1.7e5])
    muscle = bench.model("driven").muscle
    table = jnp.asarray(np.random.default_rng(3).uniform(1e5, 5e5, (6, 2)))
    force = muscle.force(0.05 + contraction * both, pressure - bench.AMBIENT, muscle.end_factor)
    return Signals(
        command=table[4],
        neutral=pressure,
        valve=bench.model("isotonic").valve,
        opening=jnp.asarray(0.4),
        supply_pressure=jnp.asarray(bench.AMBIENT + 6e5),
        valve_flow=1.2e-4 * both,
        volume=5e-5 * (1.5 + both),
        volume_rate=1e-4 * velocity * both,
        polytropic_exponent=jnp.asarray(1.2),
        pressure_rate=1e5 * both,
        past=Past(table, jnp.asarray(4), jnp.asarray(2e-3), table[0]),
        time=jnp.asarray(20.0),
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        gas_temperature=jnp.asarray(293.15),
        pipe=bench.model("jet-pipe").pipe,
        current=jnp.asarray(0.1 + 10 * contraction),
        pressure=pressure,
        mass_flow=1e-4 * both,
        contraction=0.05 + contraction * both,
        contraction_velocity=velocity * both,
        muscle=muscle,
        muscle_force=force,
        position=jnp.asarray(contraction / 0.015),
        velocity=jnp.asarray(velocity / 0.015),
        force=force,
        pressure_reading=pressure,
        position_reading=jnp.asarray(contraction / 0.015),
    )


def contribution(effect_type, strength, velocity):
    """What the effect adds, or the limit of its dry friction, from a disturbed state."""
    effect = effect_type(**{effect_type.strength: strength})
    with jax.ensure_compile_time_eval():  # numbers, to be kept for the next effect, within a compilation too
        before, now = situation(velocity, 0.004), situation(velocity, 0.004 + 2e-3 * velocity)

    def disturbed(value):
        return jax.tree.map(lambda leaf: leaf + NOISE[: leaf.size].reshape(leaf.shape), value)

    if isinstance(effect, AbstractMuscleEffect):
        radius = now.muscle.initial_radius
        return effect.altered(now.muscle).initial_radius / radius - 1
    if isinstance(effect, AbstractFrictionEffect):
        return effect.limit(now)
    if isinstance(effect, AbstractTransmissionEffect):
        return jnp.stack([of(now.position, each) for of in (effect.winding, effect.lever) for each in (0, 1)])
    if isinstance(effect, AbstractSlipEffect):
        memory = effect.update(effect.initial(before), now, jnp.asarray(2e-3))
        bristle = Bristle(effect.value(memory, now), effect.deflection(), effect.damping())
        # Of 0.04 kg m^2, nearly stuck where it does not move.
        pushed = jnp.asarray(0.7), 0.04 * now.velocity, jnp.asarray(1.0), None
        return slip_of_mass(*pushed, bristle, 0.04) - slip_of_mass(*pushed)
    if isinstance(effect, AbstractStaticEffect):
        return effect.value(now)
    if isinstance(effect, AbstractRateEffect):
        return effect.value(disturbed(effect.initial(before)), now)
    assert isinstance(effect, AbstractMemoryEffect)
    return effect.value(effect.update(disturbed(effect.initial(before)), now, jnp.asarray(2e-3)), now)


def of_strength(effect_type, velocity):
    """What an effect adds, by its strength in units of its size."""
    size = SIZES.get(effect_type.strength, 1.0)
    return lambda strength: contribution(effect_type, strength * size, velocity)


@pytest.mark.parametrize("velocity", VELOCITIES)
@ALL
def test_slope_at_zero_strength(effect_type, velocity):
    added = of_strength(effect_type, velocity)
    slope = jax.jacfwd(added)(jnp.asarray(0.0))
    # Operation by operation: nothing at zero strength is nothing to the last bit.
    zero, half, whole = (added(jnp.asarray(h)) for h in (0.0, 5e-5, 1e-4))
    assert not np.any(zero)
    assert np.isfinite(slope).all()
    # One-sided, second order, since some strengths have no other side; the bend of the sharpest (a lag of
    # 0.5 µs against a step of 2 ms) is of the order of the squared step.
    difference = (4 * half - whole) / 1e-4
    np.testing.assert_allclose(
        slope, difference, rtol=1e-5, atol=1e-6 * max(1e-12, float(np.abs(slope).max()))
    )


@ALL
def test_reverse_mode_agrees(effect_type):
    def total(strength):
        return jnp.sum(of_strength(effect_type, 0.13)(strength))

    forward = jax.jit(lambda s: jax.jvp(total, (s,), (1.0,))[1])(0.0)
    np.testing.assert_allclose(jax.jit(jax.grad(total))(0.0), forward, rtol=1e-9, atol=1e-15)
