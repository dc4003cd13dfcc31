"""Contacts of dry friction: threads and guide bend bristles of their own, and rub together as one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven
from oracles.friction import BRISTLE_TIME
from oracles.isotonic import isotonic

from jaxmuscle.effects import Presliding
from jaxmuscle.effects.contacts import bristle, slips, with_contacts
from jaxmuscle.effects.slip import slip_of_mass
from jaxmuscle.parameters import replace
from jaxmuscle.signals import Signals

CARD = bench.CARDS["isotonic"]
EFFECTS = {
    "thread_friction": {
        "static_coefficient": 0.015, "kinetic_coefficient": 0.1, "velocity_constant": 0.17,
    },
    "load_friction": {"force": 15.0},
    "presliding": {"distance": 3e-4},
}  # fmt: skip
STEP = bench.STEPS["isotonic"]


@pytest.mark.slow
@pytest.mark.parametrize("substeps", [1, 4])
def test_a_lift_whose_threads_and_guide_have_bristles_equals_the_oracle(substeps):
    """Threads rub seven times as much in motion and their bristles bend on; those of the guide do not."""
    t = np.arange(2000) * STEP
    command = 1.5 * np.sin(2 * np.pi * 1.3 * t) + 1.2 * np.sin(2 * np.pi * 0.31 * t) + 0.6
    lifted = isotonic(CARD, EFFECTS, command, STEP, bench.AMBIENT, 24)[1]
    effects = EFFECTS | {"presliding": EFFECTS["presliding"] | {"damping_time": BRISTLE_TIME}}
    machine, track = bench.model("isotonic", **effects), bench.isotonic_track(command)
    found = bench.simulated(machine, track, substeps).readings["position"]
    sharp = bench.simulated(machine.without_effects("presliding"), track, substeps).readings["position"]
    assert np.ptp(lifted) > 0.02
    assert bench.deviation(sharp, lifted) > 1e-2
    assert bench.deviation(found, lifted) < 1e-3


def test_a_muscle_that_is_moved_equals_the_oracle():
    """From sample to sample the friction changes with the velocity, and reversals lie between samples."""
    t = np.arange(600) * bench.STEPS["driven"]
    omega = 2 * np.pi * 0.7
    pressure = np.full_like(t, bench.AMBIENT + 3e5)
    motion = pressure, 0.03 + 0.02 * np.sin(omega * t), 0.02 * omega * np.cos(omega * t)
    effects = {
        "thread_friction": EFFECTS["thread_friction"], "presliding": {"distance": 4e-5},
    }  # fmt: skip
    true = driven(bench.CARDS["driven"], effects, *motion)
    effects["presliding"]["damping_time"] = BRISTLE_TIME
    machine, track = bench.model("driven", **effects), bench.driven_track(*motion)
    found = bench.simulated(machine, track, 1).readings["force"]
    sharp = bench.simulated(machine.without_effects("presliding"), track, 1).readings["force"]
    rubbing = np.ptp(driven(bench.CARDS["driven"], {}, *motion) - true)
    assert rubbing > 20
    # The law without bristles is off by the whole friction at rest where the motion turns round.
    assert np.abs(sharp - true).max() > 0.1 * rubbing
    assert np.sqrt(np.mean((found - true) ** 2)) < 3e-4 * rubbing


def built_up(limits, shares, ratio, distance, damping_time=5e-4):
    """Bristle of two contacts of one mass, with such shares of their limits in motion."""
    effects = {"presliding": Presliding(jnp.asarray(distance), jnp.asarray(damping_time))}
    signals = Signals(position=jnp.asarray(0.0), velocity=jnp.asarray(0.0))
    memory = effects["presliding"].initial(signals)
    memory = memory._replace(bend=jnp.asarray(ratio) * jnp.asarray(shares), ratio=jnp.asarray(ratio))
    signals = with_contacts(effects, signals, lambda at: tuple(limits)).having(
        limit_over_rest=jnp.asarray(ratio)
    )
    found = bristle(effects, {"presliding": memory}, signals)
    assert found is not None
    return found


@pytest.mark.slow
def test_contacts_side_by_side_share_the_friction_of_both():
    limits, shares, ratio, distance, mass = [3.0, 1.0], [0.2, 0.9], [2.0, 1.0], 1e-3, 5.0
    both = built_up(limits, shares, ratio, distance)
    driving, momentum = jnp.asarray(1.4), jnp.asarray(mass * 2e-3)
    slip = slip_of_mass(driving, momentum, jnp.asarray(4.0), None, both, mass)
    threads, guide = slips(slip, both)
    assert float(3 * threads + guide) == pytest.approx(float(4 * slip), rel=1e-12)
    # Where nothing moves and the force is in balance each contact has what it has built up.
    still = slip_of_mass(jnp.asarray(3 * 0.2 + 0.9), jnp.asarray(0.0), jnp.asarray(4.0), None, both, mass)
    np.testing.assert_allclose(slips(still, both), shares, rtol=1e-12)


def test_damping_of_contacts_adds_up():
    r""":math:`\sum L_i T (1 - z_i)/δ_i`, δ_i the distance times the limit over that at rest."""
    limits, shares, ratio, distance, mass, time = [3.0, 1.0], [0.2, 0.9], [2.0, 1.0], 10.0, 5.0, 1e-3
    both = built_up(limits, shares, ratio, distance, time)

    def friction(velocity):
        return 4 * slip_of_mass(
            jnp.asarray(3 * 0.2 + 0.9), mass * velocity, jnp.asarray(4.0), None, both, mass
        )

    slope = jax.grad(friction)(jnp.asarray(1e-3))
    wanted = sum(
        limit * time * (1 - z) / (c * distance) for limit, z, c in zip(limits, shares, ratio, strict=True)
    )
    assert float(slope) == pytest.approx(wanted, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("limits", [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
def test_a_contact_that_a_machine_does_not_have_takes_no_part(limits):
    def share(limits):
        return built_up(limits, [0.3, 0.7], [1.0, 1.0], 1e-3).share

    if any(limits):
        assert float(share(jnp.asarray(limits))) == (0.3 if limits[0] else 0.7)
    slope = jax.jacfwd(share)(jnp.asarray(limits))
    assert np.isfinite(slope).all()


def test_a_rig_that_does_not_say_its_limits_is_told_how():
    effects = {"presliding": Presliding(jnp.asarray(1e-3))}
    signals = Signals(position=jnp.asarray(0.0), velocity=jnp.asarray(0.0))
    memory = effects["presliding"].initial(signals)
    with pytest.raises(ValueError, match="calls with_contacts before it asks"):
        bristle(effects, {"presliding": memory}, signals)


@pytest.mark.slow
def test_a_lift_on_bristles_has_slopes_over_distance_and_limits():
    command = bench.isotonic_command()[:300]
    machine, track = bench.model("isotonic", **EFFECTS), bench.isotonic_track(command)
    paths = {
        "effects.presliding.distance": 3e-4,
        "effects.load_friction.force": 15.0,
        "effects.thread_friction.kinetic_coefficient": 0.1,
    }
    size = np.array(list(paths.values()))

    def position(values):
        changed = replace(machine, dict(zip(paths, values * size, strict=True)))
        return bench.simulate(changed, track, 1).readings["position"]

    at, h = jnp.ones(3), 1e-6
    slopes = np.asarray(jax.jit(jax.jacfwd(position))(at))
    run = jax.jit(position)
    differences = [(run(at + h * d) - run(at - h * d)) / (2 * h) for d in jnp.eye(3)]
    assert np.isfinite(slopes).all() and np.abs(slopes).max(0).min() > 1e-6
    np.testing.assert_allclose(slopes, np.stack(differences, -1), atol=2e-3 * np.abs(slopes).max())


@pytest.mark.slow
@pytest.mark.parametrize("velocities", [(0.0, 0.0), (0.01, -0.01), (0.01, 0.0), (0.0, 0.01), (1e-12, -3e-12)])
def test_bristles_have_slopes_where_the_motion_begins_rests_and_turns_round(velocities):
    before, after = velocities
    signals = Signals(limit_over_rest=jnp.array([2.0, 1.0]))
    effect = Presliding(jnp.asarray(1e-4))

    def bend(values):
        v0, v1, way = values
        memory = effect.initial(signals.having(position=jnp.asarray(0.0), velocity=v0))
        return effect.update(memory, signals.having(position=way, velocity=v1), jnp.asarray(1e-2)).bend

    at = jnp.array([before, after, 1e-2 * (before + after) / 2])
    slopes = jax.jacfwd(bend)(at), jax.jacrev(bend)(at)
    assert all(np.isfinite(each).all() for each in slopes)
    np.testing.assert_allclose(*slopes, rtol=1e-9, atol=1e-12 * np.abs(slopes[0]).max())
