"""At zero strength an effect changes nothing, to the last bit, whatever the state."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.actuators import Held
from jaxmuscle.actuators.sensing import sensed, sensing
from jaxmuscle.effects import FURTHER, AbstractMemoryEffect, AbstractRateEffect
from jaxmuscle.effects.base import strengths_of
from jaxmuscle.effects.chain import initial_states
from jaxmuscle.parameter_names import split_effect
from jaxmuscle.parameters import get, parameters, replace
from jaxmuscle.signals import Past


def _pairs():
    """Rigs and effects: those of the catalogue on every rig, each further one on one rig, in turn."""
    found = [(rig, effect) for rig in bench.BLANKS for effect in bench.sought(rig)]
    for number, effect in enumerate(FURTHER):
        rigs = [rig for rig in bench.BLANKS if bench.BLANKS[rig].offers(effect)]
        found.append((rigs[number % len(rigs)], effect))
    return found


PAIRS = _pairs()
IDS = [f"{rig}-{effect.name}" for rig, effect in PAIRS]
LANES, ROW = 6, 3
RANDOM = {
    "current": lambda rng: rng.uniform(-0.3, 0.3),
    "pipe": lambda rng, *shape: rng.normal(0, 2e-4, *shape),
    "opening": lambda rng: rng.uniform(-1, 1),
    "pressure": lambda rng, *shape: bench.AMBIENT + rng.uniform(0, 5e5, *shape),
    "pressure_rate": lambda rng, *shape: rng.normal(0, 1e6, *shape),
    "position": lambda rng: rng.uniform(-1e-3, 0.09),
    "contraction": lambda rng: rng.uniform(0, 0.09),
    "velocity": lambda rng: rng.choice([0.0, rng.normal(0, 0.3)]),
    "angle": lambda rng, *shape: rng.normal(0, 1.0, *shape),
    "temperature": lambda rng, *shape: rng.uniform(270, 310, *shape),
    "plays": lambda rng, *shape: rng.normal(2.0, 1.0, *shape),
    "angular_velocity": lambda rng, *shape: rng.choice([0.0, 1.0]) * rng.normal(0, 5.0, *shape),
}
SIZES = {
    "area": 1e-7,
    "delay": 3e-3,
    "force": 5.0,
    "stiffness": 100.0,
    "time_constant": 0.05,
    "inverse_limit": 20.0,
    "thickness": 1e-3,
    "compliance": 1e-5,
    "amplitude": 5.0,
    "coefficient": 1e-4,
    "distance": 1e-3,
    "inverse_rate": 0.1,
    "resistance": 1e7,
    "volume": 1e-5,
    "half_width": 1e-3,
    "cubic": 1e-8,
}
COMPANIONS = {"presliding": {"load_friction": {"force": 1e4}, "thread_friction": bench.THREADS}}
"""Effects without which one does nothing."""
COMPANION_VALUES = {name: values for own in COMPANIONS.values() for name, values in own.items()}
SHAPES = {
    "joint": {"pressure": (2,), "pressure_rate": (2,)},
    "elbow": {"plays": (10,)},
    "scara": {"pressure": (4,), "pressure_rate": (4,), "angle": (2,), "angular_velocity": (2,)},
    "jet-pipe": {"pipe": (3,), "pressure": (2,)},
    "jet-pipe-piston": {"pipe": (3,), "pressure": (2,), "temperature": (2,)},
}
STATES = {
    "isotonic": ("opening", "pressure", "position", "velocity"),
    "driven": ("pressure", "contraction", "velocity"),
    "joint": ("pressure", "pressure_rate", "angle", "angular_velocity"),
    "elbow": ("pressure", "pressure_rate", "plays"),
    "scara": ("pressure", "pressure_rate", "angle", "angular_velocity"),
    "jet-pipe": ("current", "pipe", "pressure"),
    "jet-pipe-piston": ("current", "pipe", "pressure", "temperature", "position", "velocity"),
}


def drawn(rig, seed):
    """A random state of the rig and a random history of its command."""
    rng = np.random.default_rng(seed)
    shapes = SHAPES.get(rig, {})
    state = {name: jnp.asarray(RANDOM[name](rng, *shapes.get(name, ()))) for name in STATES[rig]}
    table = rng.uniform(-5, 5, (6,))
    if rig in ("joint", "scara"):
        table = bench.AMBIENT + rng.uniform(0, 5e5, (6, len(bench.BLANKS[rig].commands)))
    if rig == "jet-pipe-piston":
        table = np.stack([table, bench.AMBIENT + rng.uniform(4e5, 6e5, 6)], axis=1)
    return state, jnp.asarray(table), jnp.asarray(rng.normal(0, 0.1, 64))


def held(rig, table, memory):
    past = Past(table, jnp.asarray(ROW), jnp.asarray(2e-3), table[0]) if rig != "driven" else None
    return Held(table[ROW], past, memory, time=jnp.asarray(7.0))


def companions(rig, effect):
    """What an effect needs beside it on a rig."""
    offered = {effect.name for effect in bench.offered(rig)}
    return {name: v for name, v in COMPANIONS.get(effect.name, {}).items() if name in offered}


def disturbed(value, noise):
    """An effect's state moved away from where it rests."""
    return jax.tree.map(lambda leaf: leaf + noise[: leaf.size].reshape(leaf.shape), value)


def outcome(actuator, rig, state, table, noise):
    """Rates of the machine's own states, readings, and the largest of what the effects add."""
    bare = actuator.without_effects(*actuator.effects)
    before = sensing(actuator, bare.signals(state, held(rig, table, {})))
    states, memory = initial_states(actuator.effects, before)
    states, memory = disturbed(states, noise), disturbed(memory, noise)
    for name, effect in actuator.effects.items():
        if isinstance(effect, AbstractMemoryEffect):
            memory[name] = effect.update(memory[name], before, jnp.asarray(1e-3))
    situation = held(rig, table, memory)
    state = {**state, "effects": states}
    rates = actuator.vector_field(state, situation)
    readings = sensed(actuator, actuator.signals(state, situation), {**states, **memory})
    return {n: r for n, r in rates.items() if n != "effects"}, readings


@functools.cache
def random_lanes(rig):
    """States, histories and noise, one a lane."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *[drawn(rig, seed) for seed in range(LANES)])


@functools.cache
def bare_outcomes(rig, needed):
    """What a machine gives that carries only what an effect needs beside it, by name."""
    bare = bench.model(rig, **{name: COMPANION_VALUES[name] for name in needed})
    return jax.vmap(lambda lane: outcome(bare, rig, *lane))(random_lanes(rig))


def assert_identical(left, right):
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("rig", "effect"), PAIRS, ids=IDS)
def test_changes_nothing_at_zero_strength(rig, effect):
    needed = companions(rig, effect)
    carrying, lanes = bench.model(rig, [effect.name], **needed), random_lanes(rig)
    without = bare_outcomes(rig, tuple(needed))
    assert_identical(without, jax.vmap(lambda lane: outcome(carrying, rig, *lane))(lanes))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(without))


@pytest.mark.parametrize(("rig", "effect"), PAIRS, ids=IDS)
def test_its_other_parameters_change_nothing_at_zero_strength(rig, effect):
    """So an effect is there exactly where one of its strengths differs from none."""
    needed = companions(rig, effect)
    carrying = bench.model(rig, [effect.name], **needed)
    own = {
        path: entry for path, entry in parameters(carrying).items() if split_effect(path)[0] == effect.name
    }
    strengths = {f"effects.{effect.name}.{name}" for name in strengths_of(effect)}
    moved = {
        path: 1.7 * entry.value or entry.typical or 0.3
        for path, entry in own.items()
        if path not in strengths
    }
    assert strengths <= set(own) and all(own[path].value == 0 for path in strengths)
    shaped = replace(carrying, moved) if moved else carrying
    found = jax.vmap(lambda lane: outcome(shaped, rig, *lane))(random_lanes(rig))
    assert_identical(bare_outcomes(rig, tuple(needed)), found)


@pytest.mark.parametrize(("rig", "effect"), PAIRS, ids=IDS)
def test_changes_something_otherwise(rig, effect):
    path = f"effects.{effect.name}.{effect.strength}"
    needed = companions(rig, effect)
    strength = {effect.strength: SIZES.get(effect.strength, 0.1)}
    strong = bench.model(rig, **needed, **{effect.name: strength})
    assert parameters(strong)[path].value == get(strong, path) != 0
    with_effect = jax.vmap(lambda lane: outcome(strong, rig, *lane))(random_lanes(rig))
    pairs = zip(jax.tree.leaves(bare_outcomes(rig, tuple(needed))), jax.tree.leaves(with_effect), strict=True)
    assert any(np.any(a != b) for a, b in pairs)


@pytest.mark.slow
@pytest.mark.parametrize("rig", bench.BLANKS)
def test_all_at_zero_strength_change_nothing_when_compiled(rig):
    names = [effect.name for effect in bench.offered(rig)]
    state = drawn(rig, 0)
    bare = jax.jit(lambda lane: outcome(bench.model(rig), rig, *lane))(state)
    carrying = jax.jit(lambda lane: outcome(bench.model(rig, names), rig, *lane))(state)
    for a, b in zip(jax.tree.leaves(bare), jax.tree.leaves(carrying), strict=True):
        # A compiler may contract a product and a sum differently: the last few bits.
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-9)


@pytest.mark.parametrize(
    "effect", dict.fromkeys(effect for _, effect in PAIRS), ids=lambda effect: effect.name
)
def test_strength_is_zero_unless_declared(effect):
    assert float(getattr(effect(), effect.strength)) == 0.0


def test_every_kind_of_effect_is_covered():
    kinds = {kind for _, effect in PAIRS for kind in effect.__mro__}
    assert {AbstractMemoryEffect, AbstractRateEffect} <= kinds
