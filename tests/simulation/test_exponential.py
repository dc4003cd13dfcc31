"""The exponential method: exact on linear systems, second order on others, Heun where nothing is linear."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxmuscle._linalg import propagator
from jaxmuscle.simulation.solvers import ExponentialHeun

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


@pytest.mark.slow
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
