"""Dry friction that is smoothed more widely: every machine that has some slips otherwise."""

import jax.numpy as jnp
import numpy as np
import pytest
from effects.test_zero_strength import ROW, STATES, drawn
from oracles import bench
from oracles.robot_bench import AMBIENT
from oracles.robot_bench import machine as robot

from jaxmuscle.actuators import Held
from jaxmuscle.effects import CATALOGUE, FURTHER
from jaxmuscle.effects.base import AbstractFrictionEffect
from jaxmuscle.signals import Past

DRY = [effect for effect in (*CATALOGUE, *FURTHER) if issubclass(effect, AbstractFrictionEffect)]
PAIRS = [(rig, effect) for rig, blank in bench.BLANKS.items() for effect in DRY if blank.offers(effect)]
RATES = ("velocity", "angular_velocity")
PULLED = {
    "pressure": AMBIENT + jnp.array([3e5, 2e5, 1.5e5, 3.2e5]),
    "pressure_rate": jnp.zeros(4),
    "angle": jnp.array([0.3, -0.8]),
}


def machine_and_state(rig, effect):
    """With friction far above anything that acts, and a random state that hardly moves."""
    strong = effect(**{effect.strength: 1e4})
    if rig == "scara":
        state = {**PULLED, "angular_velocity": jnp.array([2e-4, -1e-4])}
        return robot(friction=False).with_effects(**{effect.name: strong}), state, PULLED["pressure"]
    state, table, _ = drawn(rig, 0)
    # Of a muscle that is being pulled longer, where friction adds to the tension: none can push.
    slow = -2e-5 if rig == "driven" else 2e-5
    state |= {name: jnp.asarray(slow) for name in RATES if name in STATES[rig]}
    return bench.model(rig).with_effects(**{effect.name: strong}), state, table[ROW]


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "effect"), PAIRS, ids=[f"{rig}-{effect.name}" for rig, effect in PAIRS])
def test_widening_changes_the_slip(rig, effect):
    actuator, state, command = machine_and_state(rig, effect)
    past = Past(jnp.stack([command] * 2), jnp.asarray(0), jnp.asarray(2e-3), command)
    state = {**state, "effects": {}}
    sharp, once, wide = (
        actuator.signals(state, Held(command, past, {}, widening))
        for widening in (None, jnp.asarray(1.0), jnp.asarray(20.0))
    )
    left = "force" if rig == "driven" else "load"
    np.testing.assert_array_equal(getattr(sharp, left), getattr(once, left))
    assert (np.abs(getattr(wide, left) - getattr(sharp, left)) > 1e-6).all()
    if effect.slot.name == "load":
        # What friction leaves is what brings the mass to rest, m v/τ: a twentieth of it when wide, but for
        # Coriolis terms.
        np.testing.assert_allclose(20 * wide.load, sharp.load, rtol=1e-5)


def test_every_machine_with_friction_is_looked_at():
    assert {rig for rig, _ in PAIRS} >= {"isotonic", "driven", "joint", "jet-pipe-piston", "scara"}
