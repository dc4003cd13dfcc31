"""The muscle described by its thread is the muscle described by its angle: values, slopes, whole rigs."""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.components import McKibben, ThreadMuscle, described_by_thread
from jaxmuscle.components.contraction import largest_contraction

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
