"""Small systems against LAPACK, their derivatives, what is singular."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle.analysis.elimination import solve

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("kind", ["real", "complex", "badly scaled", "needs swaps"])
def test_equals_lapack(kind):
    matrices, right = RNG.normal(size=(20, 6, 6)), RNG.normal(size=(20, 6))
    if kind == "complex":
        matrices = matrices + 1j * RNG.normal(size=matrices.shape)
        right = right.astype(complex)
    if kind == "badly scaled":
        matrices = matrices * 10.0 ** RNG.uniform(-9, 9, (20, 6, 1))
    if kind == "needs swaps":
        matrices = matrices * (1 - np.eye(6))
    found = jax.vmap(solve)(jnp.asarray(matrices), jnp.asarray(right))
    np.testing.assert_allclose(found, np.linalg.solve(matrices, right[..., None])[..., 0], rtol=1e-9)


def test_derivatives_are_those_of_the_inverse():
    matrix, right, way = RNG.normal(size=(5, 5)), RNG.normal(size=5), RNG.normal(size=(5, 5))
    x = np.linalg.solve(matrix, right)
    moved = jax.jvp(lambda m: solve(m, jnp.asarray(right)), (jnp.asarray(matrix),), (jnp.asarray(way),))[1]
    np.testing.assert_allclose(moved, -np.linalg.solve(matrix, way @ x), rtol=1e-9)
    pulled = jax.grad(lambda r: solve(jnp.asarray(matrix), r)[0])(jnp.asarray(right))
    np.testing.assert_allclose(pulled, np.linalg.inv(matrix)[0], rtol=1e-9)


def test_singular_is_not_finite():
    assert not np.isfinite(solve(jnp.array([[1.0, 2.0], [2.0, 4.0]]), jnp.ones(2))).all()
    assert not np.isfinite(solve(jnp.array([[1.0, 0.0], [0.0, 0.0]]), jnp.ones(2))).all()
