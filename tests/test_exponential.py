"""The exponential method: exact on linear systems, second order on others, derivatives of its matrices."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import subjaxprs
from oracles import bench
from scipy.linalg import expm

import jaxmuscle as jm
from jaxmuscle.exponential import ExponentialHeun, propagator

A = jnp.array([[-0.1, 1856.7, 0.0], [-1856.7, -70.0, 0.0], [0.0, 0.0, 0.0]])


def steps(field, matrix, start, width, count):
    solver, term = ExponentialHeun(propagator(matrix, jnp.asarray(width))), diffrax.ODETerm(field)
    y = start
    for n in range(count):
        y, *_ = solver.step(term, n * width, (n + 1) * width, y, None, None, made_jump=False)
    return y


def test_exact_with_a_constant_and_a_ramp():
    start, constant = jnp.array([1.0, -2.0, 0.5]), jnp.array([0.3, 40.0, 2.0])
    end = steps(lambda t, y, _: A @ y + constant * t, A, start, 2e-3, 5)
    # The ramp as two further states.
    large = jnp.zeros((5, 5)).at[:3, :3].set(A).at[:3, 3].set(constant).at[3, 4].set(1.0)
    exact = expm(0.01 * large) @ jnp.concatenate([start, jnp.array([0.0, 1.0])])
    np.testing.assert_allclose(end, exact[:3], rtol=1e-10)


def test_second_order_with_a_part_that_is_not_linear():
    matrix = jnp.diag(jnp.array([-200.0, 0.0]))

    def field(t, y, _):
        return matrix @ y + jnp.array([200 * jnp.sin(y[1]), y[0] * jnp.cos(3 * t) - y[1] ** 2])

    def end(count):
        return steps(field, matrix, jnp.array([0.2, 1.0]), 0.2 / count, count)

    reference = end(1280)
    errors = [float(jnp.abs(end(count) - reference).max()) for count in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.9)
    assert errors[1] / errors[2] == pytest.approx(4.0, abs=0.5)


def test_heun_without_a_linear_part():
    def field(t, y, _):
        return -(y**2) + t

    y, h = jnp.array([1.3]), 0.1
    first = y + h * field(0.0, y, None)
    heun = y + h / 2 * (field(0.0, y, None) + field(h, first, None))
    np.testing.assert_allclose(steps(field, jnp.zeros((1, 1)), y, h, 1), heun, rtol=1e-14)


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


def test_matrices_of_a_batch_and_their_derivatives_backwards():
    widths = jnp.array([1e-6, 5e-4, 0.02])
    first = jax.vmap(lambda h: propagator(A, h).first)
    for width, found in zip(widths, first(widths), strict=True):
        np.testing.assert_allclose(found, propagator(A, width).first, rtol=1e-13, atol=1e-18)
    total = lambda h: propagator(A, h).second.sum()  # noqa: E731
    for width in widths:
        np.testing.assert_allclose(jax.grad(total)(width), jax.jacfwd(total)(width), rtol=1e-10)


# Operations of JAX that are calls of LAPACK on a CPU.
LAPACK = {"lu", "qr", "cholesky", "eigh", "eig", "svd", "schur", "hessenberg", "triangular_solve", "geqrf"}


def operations(jaxpr):
    """Names of all operations, those in loops, branches and functions too."""
    inner = [operations(each) for each in subjaxprs(jaxpr)]
    return {equation.primitive.name for equation in jaxpr.eqns}.union(*inner)


def test_what_a_solution_consists_of_is_seen():
    looping = lambda x: jax.lax.fori_loop(0, 3, lambda i, y: jnp.linalg.solve(A + x, y), jnp.ones(3))  # noqa: E731
    assert {"lu", "triangular_solve"} <= operations(jax.make_jaxpr(jax.jit(looping))(1.0).jaxpr)


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
