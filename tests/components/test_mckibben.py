"""The McKibben muscle: numbers of [T], equivalent forms, and slopes.

The muscle described by its thread is the muscle described by its angle: values, slopes, whole rigs.
"""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles import muscle as oracle

from jaxmuscle.components import McKibben, ThreadMuscle, described_by_thread
from jaxmuscle.components.mckibben import largest_contraction

LENGTH, RADIUS, ANGLE = 0.3, 0.007, np.deg2rad(20)
CARD = {"initial_length": LENGTH, "initial_radius": RADIUS, "braid_angle": ANGLE, "end_factor": 1.303}
MUSCLE = McKibben(*CARD.values())
STRAINS = np.linspace(-0.02, 0.3, 9)


def force(strain, gauge, k=1.303):
    return MUSCLE.force(jnp.asarray(strain * LENGTH), jnp.asarray(gauge), jnp.asarray(k))


def test_largest_force_of_the_reference_muscle():
    # 1084 N comes from a = 22.64 and b = 8.55; their rounding is worth 0.8 N.
    assert float(force(0.0, 5e5)) == pytest.approx(1084, abs=1.3)


@pytest.mark.parametrize(("k", "largest"), [(1.0, 0.3856), (1.303, 0.296)])
def test_largest_contraction_of_the_reference_muscle(k, largest):
    assert float(force(largest - 1e-4, 5e5, k)) > 0 > float(force(largest + 1e-4, 5e5, k))


def test_largest_contraction_in_closed_form():
    assert float(force(1 - 1 / (np.sqrt(3) * np.cos(ANGLE)), 5e5, 1.0)) == pytest.approx(0, abs=1e-9)


def test_equals_schultes_form():
    # [T] 6 with the braid's diameter at 90°, D90 = 2 r0 / sin α0.
    expected = [oracle.schulte_force(CARD, strain, 3e5, 1.303) for strain in STRAINS]
    np.testing.assert_allclose(force(STRAINS, 3e5), expected, rtol=1e-12)


def test_force_is_the_work_of_the_volume():
    # Virtual work without conic ends: F dx = P dV.
    contraction = STRAINS * LENGTH
    np.testing.assert_allclose(
        force(STRAINS, 3e5, 1.0), 3e5 * MUSCLE.volume_slope(jnp.asarray(contraction)), rtol=1e-12
    )


def test_volume_at_rest_is_that_of_the_cylinder():
    assert float(MUSCLE.volume(jnp.asarray(0.0))) == pytest.approx(np.pi * RADIUS**2 * LENGTH, rel=1e-14)


def test_volume_and_its_slope_equal_the_oracle():
    volume, slope = np.transpose([oracle.cylinder(CARD, x) for x in STRAINS * LENGTH])
    np.testing.assert_allclose(MUSCLE.volume(jnp.asarray(STRAINS * LENGTH)), volume, rtol=1e-12)
    np.testing.assert_allclose(MUSCLE.volume_slope(jnp.asarray(STRAINS * LENGTH)), slope, rtol=1e-12)


def test_volume_slope_is_the_derivative_of_the_volume():
    contraction = jnp.asarray(STRAINS * LENGTH)
    np.testing.assert_allclose(
        MUSCLE.volume_slope(contraction), jax.vmap(jax.grad(MUSCLE.volume))(contraction), rtol=1e-12
    )


def test_volume_is_largest_where_the_force_vanishes():
    largest = LENGTH * (1 - 1 / (np.sqrt(3) * np.cos(ANGLE)))
    assert float(MUSCLE.volume_slope(jnp.asarray(largest))) == pytest.approx(0, abs=1e-15)


def test_contact_surface_at_rest():
    assert float(MUSCLE.contact_surface(jnp.asarray(0.0))) == pytest.approx(
        2 * np.pi * RADIUS * LENGTH, rel=1e-12
    )


def test_contact_surface_shrinks_to_two_thirds():
    shortened = jnp.asarray(0.3 / 1.303 * LENGTH)
    ratio = MUSCLE.contact_surface(shortened) / MUSCLE.contact_surface(jnp.asarray(0.0))
    assert float(ratio) == pytest.approx(0.65, abs=0.005)


def test_contact_surface_equals_the_oracle():
    expected = [oracle.contact(CARD, strain) for strain in STRAINS]
    np.testing.assert_allclose(MUSCLE.contact_surface(jnp.asarray(STRAINS * LENGTH)), expected, rtol=1e-12)


def test_swelling_follows_the_braid():
    # [T] 3: r / r0 = sin α / sin α0 with cos α = (l / l0) cos α0.
    ratio = 1 - STRAINS
    expected = np.sin(np.arccos(ratio * np.cos(ANGLE))) / np.sin(ANGLE)
    np.testing.assert_allclose(MUSCLE.swelling(jnp.asarray(ratio)), expected, rtol=1e-12)


@pytest.mark.parametrize("quantity", ["force", "volume", "contact_surface", "volume_slope"])
@pytest.mark.parametrize("strain", [0.0, 0.1, 0.29])
def test_slopes_equal_finite_differences(quantity, strain):
    def value(entries):
        muscle, contraction, gauge = McKibben(*entries[:4]), entries[4], entries[5]
        if quantity == "force":
            return muscle.force(contraction, gauge, muscle.end_factor)
        return getattr(muscle, quantity)(contraction)

    point = jnp.array([LENGTH, RADIUS, ANGLE, 1.303, strain * LENGTH, 3e5])
    size = jnp.array([LENGTH, RADIUS, ANGLE, 1.303, LENGTH, 3e5])
    steps = 3e-6 * jnp.diag(size)
    difference = jax.vmap(lambda step: (value(point + step) - value(point - step)) / 6e-6)(steps)
    slope = jax.grad(value)(point) * size
    # The differences' own error is of the order of the squared step and of rounding, 1e-10 both.
    np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-8 * float(jnp.abs(slope).max()))


@pytest.mark.parametrize("strain", [1 / 1.303, 0.9, 1.5, -0.06, -0.2])
def test_thread_surface_is_finite_where_the_law_has_no_meaning(strain):
    # Folded up beyond kε = 1, and longer than the threads.
    for of in (MUSCLE.contact_surface, lambda x: MUSCLE.swelling(1 - 1.303 * x / LENGTH)):
        value, slope = jax.value_and_grad(of)(jnp.asarray(LENGTH * strain))
        assert np.isfinite(value) and value >= 0 and np.isfinite(slope)


ANGLES = np.deg2rad([20.0, 23.0, 30.0])
"""Braid angles of [T]."""


def muscle(angle):
    return bench.built(McKibben, 0.3, 0.007, angle, 1.303)


def grid(model, points=31):
    """Contractions from a little stretched to the largest one."""
    return jnp.linspace(-0.02 * 0.3, float(largest_contraction(model)), points)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("gauge", [0.0, 1e5, 5e5])
def test_force_is_equal_over_the_whole_range(angle, gauge):
    by_angle = muscle(angle)
    by_thread = described_by_thread(by_angle)
    x, p = grid(by_angle), jnp.asarray(gauge)
    for k in (1.0, 1.303):
        ours, theirs = (m.force(x, p, jnp.asarray(k)) for m in (by_thread, by_angle))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12 * gauge * 1e-2)


@pytest.mark.parametrize("angle", ANGLES)
def test_gradients_are_equal_over_the_whole_range(angle):
    by_angle = muscle(angle)

    def force(model, x, p, k):
        return model.force(x, p, k)

    for x in grid(by_angle, 7):
        point = (x, jnp.asarray(3e5), jnp.asarray(1.303))
        theirs = jax.grad(force, argnums=(1, 2, 3))(by_angle, *point)
        ours = jax.grad(force, argnums=(1, 2, 3))(described_by_thread(by_angle), *point)
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12)
        # And with respect to the geometry, through the change of description.
        slopes = jax.grad(lambda m, q=point: force(described_by_thread(m), *q))(by_angle)
        expected = jax.grad(force)(by_angle, *point)
        for ours, theirs in zip(jax.tree.leaves(slopes), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("quantity", ["volume", "volume_slope", "contact_surface", "swelling"])
def test_geometry_is_equal(quantity):
    by_angle = muscle(ANGLES[0])
    x = grid(by_angle) if quantity != "swelling" else jnp.linspace(0.7, 1.02, 9)
    ours, theirs = (getattr(m, quantity)(x) for m in (described_by_thread(by_angle), by_angle))
    np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-17)


def test_description_goes_there_and_back():
    by_angle = muscle(ANGLES[1])
    back = described_by_thread(by_angle).described_by_angle()
    np.testing.assert_allclose(jax.tree.leaves(back), jax.tree.leaves(by_angle), rtol=1e-14)


def test_turns_and_thread_are_those_of_the_braid():
    # Unrolled, a thread is the diagonal of a rectangle of l0 by n circumferences.
    thread = described_by_thread(muscle(ANGLES[0]))
    around = float(thread.turns) * 2 * np.pi * 0.007
    assert float(thread.thread_length) == pytest.approx(np.hypot(0.3, around))
    assert float(thread.braid_diameter) == pytest.approx(2 * 0.007 / np.sin(ANGLES[0]))


def test_slopes_over_thread_and_turns_equal_finite_differences():
    thread = described_by_thread(muscle(ANGLES[0]))
    point = jnp.asarray(jax.tree.leaves(thread))

    def force(values):
        return ThreadMuscle(*values).force(jnp.asarray(0.03), jnp.asarray(3e5), values[3])

    for i, slope in enumerate(jax.grad(force)(point)):
        step = 1e-6 * float(point[i]) * np.eye(4)[i]
        difference = (force(point + step) - force(point - step)) / (2e-6 * float(point[i]))
        assert float(slope) == pytest.approx(float(difference), rel=1e-7)


def test_either_stands_in_a_rig():
    whole = {"thread_friction": bench.THREADS, "bladder_hoop_stiffness": bench.WALL}
    actuator = bench.model("joint", **whole)
    other = eqx.tree_at(lambda m: m.muscle, actuator, cast(Any, described_by_thread(actuator.muscle)))
    track = bench.joint_track(bench.joint_command()[:200])
    ours, theirs = (bench.simulated(m, track, 4).readings["angle"] for m in (other, actuator))
    assert np.ptp(np.asarray(theirs)) > 0.05
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
