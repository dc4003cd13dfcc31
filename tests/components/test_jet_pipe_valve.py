"""Common area of two circles, and its derivatives where circles touch, cover or lie on each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxmuscle.components import circle_overlap

R = 0.4826e-3


def by_counting(offset, r, big, cells=2000):
    """Area by counting the cells of a grid over the first circle."""
    x = (np.arange(cells) + 0.5) / cells * 2 * r - r
    u, v = np.meshgrid(x, x)
    inside = (u**2 + v**2 < r**2) & ((u - offset) ** 2 + v**2 < big**2)
    return inside.sum() * (2 * r / cells) ** 2


@pytest.mark.parametrize("big", [1.0, 3.0])
@pytest.mark.parametrize("offset", [-3.7, -2.3, -1.1, -0.3, 0.0, 0.4, 1.9, 2.6, 4.2])
def test_equals_the_count_of_cells(offset, big):
    area = circle_overlap(offset * R, R, big * R)
    np.testing.assert_allclose(area, by_counting(offset * R, R, big * R), atol=1e-4 * np.pi * R**2)


def test_limits():
    np.testing.assert_array_equal(circle_overlap(jnp.array([2.0, 2.5, -9.0]), 1.0, 1.0), 0.0)
    np.testing.assert_allclose(circle_overlap(jnp.array([0.0, 1.0, -2.0]), 1.0, 3.0), np.pi, rtol=1e-15)
    np.testing.assert_allclose(circle_overlap(jnp.zeros(2), 1.0, 1.0), np.pi, rtol=1e-15)


@pytest.mark.parametrize(("offset", "r", "big"), [(1.3, 1.0, 1.0), (-2.9, 1.0, 3.0), (2.2, 1.5, 1.2)])
def test_derivatives_inside(offset, r, big):
    check_grads(circle_overlap, (offset, r, big), order=1, modes=("fwd", "rev"), rtol=1e-6)


@pytest.mark.parametrize(
    ("offset", "r", "big", "slope"),
    [
        (2.0, 1.0, 1.0, 0.0),  # about to touch
        (2.5, 1.0, 1.0, 0.0),
        (-2.5, 1.0, 1.0, 0.0),
        (2.0, 1.0, 3.0, 0.0),  # about to be uncovered
        (0.0, 1.0, 3.0, 0.0),
        (0.0, 1.0, 1.0, -2.0),  # on each other: towards larger offsets
    ],
)
def test_one_sided_slope_at_the_edges(offset, r, big, slope):
    found = jax.vmap(jax.grad(circle_overlap), in_axes=(0, None, None))(jnp.array([offset]), r, big)[0]
    h = 1e-8
    forward = (circle_overlap(offset + h, r, big) - circle_overlap(offset, r, big)) / h
    assert found == pytest.approx(slope, abs=1e-12)
    assert forward == pytest.approx(slope, abs=1e-3)


@pytest.mark.parametrize("offset", [0.0, 1.0, 2.0, 4.0, 5.0])
def test_all_derivatives_are_numbers(offset):
    for big in (1.0, 3.0):
        slopes = jax.grad(circle_overlap, argnums=(0, 1, 2))(offset, 1.0, big)
        assert np.isfinite(slopes).all()
    covered = jax.grad(circle_overlap, argnums=(1, 2))(0.5, 1.0, 3.0)
    np.testing.assert_allclose(covered, [2 * np.pi, 0.0], atol=1e-12)
