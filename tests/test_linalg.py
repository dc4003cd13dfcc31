"""Functions of a matrix, their derivatives, and that no rig needs LAPACK for them.

Small systems against LAPACK, their derivatives, what is singular.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from operations import LAPACK, operations
from oracles import bench
from scipy.linalg import expm

import jaxmuscle as jm
from jaxmuscle._linalg import propagator, solve

A = jnp.array([[-0.1, 1856.7, 0.0], [-1856.7, -70.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.mark.slow
def test_derivative_of_the_matrices():
    def total(w):
        p = propagator(A * w, jnp.asarray(5e-4))
        return jnp.stack([p.whole, p.first, p.second])

    difference = (total(1 + 1e-6) - total(1 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.jacfwd(total)(1.0), difference, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("width", [0.0, 1e-7, 3e-5, 5e-4, 2e-3, 0.1])
def test_functions_of_a_matrix(width):
    """As blocks of the exponential of one larger matrix (Van Loan 1978)."""
    p, one, zero = propagator(A, jnp.asarray(width)), np.eye(3), np.zeros((3, 3))
    top = expm(np.block([[width * np.asarray(A), one, zero], [zero, zero, one], [zero, zero, zero]]))[:3]
    for found, exact in (
        (p.whole, top[:, :3]),
        (p.first, width * top[:, 3:6]),
        (p.second, width * top[:, 6:]),
    ):
        np.testing.assert_allclose(found, exact, rtol=0, atol=3e-14 * max(np.abs(exact).max(), 1e-300))


def test_a_long_step_comes_to_rest_and_an_absurd_one_is_no_number():
    stable = A[:2, :2]
    p = propagator(stable, jnp.asarray(10.0))
    np.testing.assert_allclose(p.whole, 0.0, atol=1e-100)
    np.testing.assert_allclose(p.first, -np.linalg.inv(stable), rtol=1e-12, atol=1e-18)
    assert jnp.isnan(propagator(stable, jnp.asarray(1e4)).whole).all()


@pytest.mark.slow
def test_matrices_of_a_batch_and_their_derivatives_backwards():
    widths = jnp.array([1e-6, 5e-4, 0.02])
    first = jax.vmap(lambda h: propagator(A, h).first)
    for width, found in zip(widths, first(widths), strict=True):
        np.testing.assert_allclose(found, propagator(A, width).first, rtol=1e-13, atol=1e-18)
    total = lambda h: propagator(A, h).second.sum()  # noqa: E731
    for width in widths:
        np.testing.assert_allclose(jax.grad(total)(width), jax.jacfwd(total)(width), rtol=1e-10)


def test_what_a_solution_consists_of_is_seen():
    looping = lambda x: jax.lax.fori_loop(0, 3, lambda i, y: jnp.linalg.solve(A + x, y), jnp.ones(3))  # noqa: E731
    assert {"lu", "triangular_solve"} <= operations(jax.make_jaxpr(jax.jit(looping))(1.0).jaxpr)


@pytest.mark.slow
@pytest.mark.parametrize("rig", sorted(set(bench.CARDS) - {"driven"}))
def test_no_rig_calls_lapack_in_a_batch(rig):
    """Two batches at a time on two cores would wait for ever; each machine differs in all its parameters."""
    machine = bench.model(rig)
    dynamic, static = eqx.partition(machine, eqx.is_inexact_array)
    leaves, tree = jax.tree.flatten(dynamic)
    commands = np.zeros((4, len(machine.commands))).squeeze()

    def run(leaves):
        whole = eqx.combine(jax.tree.unflatten(tree, leaves), static)
        return jm.simulate(whole, commands, np.arange(4) * bench.STEPS[rig]).readings

    pushed = lambda leaves: jax.jvp(run, (leaves,), (leaves,))  # noqa: E731
    batch = [jnp.stack([leaf, leaf]) for leaf in leaves]
    found = operations(jax.make_jaxpr(jax.vmap(pushed))(batch).jaxpr)
    assert {"add", "mul"} <= found and not LAPACK & found


def test_digits_are_lost_as_the_norm_grows():
    """A hundred turns of a state that is 300 times as large as the other."""
    omega, width = 300.0, 2.0
    p = propagator(jnp.array([[0.0, 1.0], [-(omega**2), 0.0]]), jnp.asarray(width))
    turned, size = omega * width, omega**2 * width
    exact = np.array([[np.cos(turned), np.sin(turned) / omega], [-omega * np.sin(turned), np.cos(turned)]])
    np.testing.assert_allclose(p.whole, exact, rtol=0, atol=2e-16 * size * omega)


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
