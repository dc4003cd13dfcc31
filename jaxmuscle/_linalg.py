"""Small dense linear algebra without LAPACK: functions of a matrix for exponential integrators, a solver.

Batched LAPACK kernels of jaxlib spread over the very threads that run the computation and wait there. Two of
them in one computation, such as the eigenvalues and the frequency responses of many linear models, wait for
each other for ever where there are two cores (seen with jaxlib 0.10).
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Inexact, Int

Matrix = Float[Array, "n n"]
Functions = tuple[Matrix, Matrix, Matrix]

SMALL, DEGREE = 0.5, 12
"""Norm up to which a series of this degree is exact to rounding: what follows is below 10⁻¹⁶."""
MOST_HALVINGS = 24
"""Halvings of a step at most; as many doublings are always computed, for derivatives in both directions."""


class Propagator(eqx.Module):
    r"""What one step of width h needs of A: :math:`e^{Ah}`, :math:`h φ_1(Ah)`, :math:`h φ_2(Ah)`.

    :math:`φ_1(z) = (e^z - 1)/z,\ φ_2(z) = (φ_1(z) - 1)/z`.
    """

    matrix: Matrix
    whole: Matrix
    first: Matrix
    second: Matrix


def propagator(matrix: Matrix, width: Array) -> Propagator:
    r"""The propagator of `matrix` over steps of `width`, by scaling and modified squaring.

    Of :math:`z = Ah/2^s` with a norm up to 1/2 the series :math:`φ_2(z) = \sum_k z^k/(k+2)!` gives
    :math:`φ_1 = z φ_2 + 1` and :math:`e^z = z φ_1 + 1`. Then s times :math:`e^{2z} = (e^z)^2`,
    :math:`φ_1(2z) = (e^z φ_1 + φ_1)/2` and :math:`φ_2(2z) = (e^z φ_2 + φ_1 + φ_2)/4` (Skaflestad and Wright,
    "The scaling and modified squaring method for matrix functions related to the exponential", Appl. Numer.
    Math. 59, 2009).

    Products alone, since `jax.scipy.linalg.expm` calls LAPACK: of a batch of matrices jaxlib 0.10 hands parts
    to XLA's threads and waits for them on one of these, and as many batches at a time as there are threads
    wait for ever. Entries are off by about 10⁻¹⁶ of the largest times the norm of Ah, of which balanced
    states have little; beyond 2²³ they are not a number.
    """
    one, scaled = jnp.eye(matrix.shape[0]), width * matrix
    norm = jax.lax.stop_gradient(jnp.abs(scaled).sum(axis=0).max())
    halvings = jnp.ceil(jnp.log2(jnp.maximum(norm, SMALL) / SMALL))
    z = jnp.where(halvings <= MOST_HALVINGS, scaled, jnp.nan) * 2.0**-halvings
    second = one / math.factorial(DEGREE + 2)
    for power in reversed(range(DEGREE)):
        second = z @ second + one / math.factorial(power + 2)
    first = z @ second + one

    def doubled(number: Array, now: Functions) -> Functions:
        whole, first, second = now
        twice = whole @ whole, (whole @ first + first) / 2, (whole @ second + first + second) / 4
        return jax.tree.map(lambda new, old: jnp.where(number < halvings, new, old), twice, now)

    whole, first, second = jax.lax.fori_loop(0, MOST_HALVINGS, doubled, (z @ first + one, first, second))
    return Propagator(matrix, whole, width * first, width * second)


def solve(matrix: Inexact[Array, "n n"], right: Inexact[Array, " n"]) -> Inexact[Array, " n"]:
    """The solution of matrix · x = right by Gauss-Jordan elimination with scaled partial pivoting.

    Real or complex, of a handful of unknowns; may be vmapped and differentiated. Not finite where the matrix
    is singular.
    """
    size = right.shape[0]
    rows = jnp.arange(size)
    largest = jnp.abs(matrix).max(axis=1, keepdims=True)
    scale = jax.lax.stop_gradient(jnp.where(largest > 0, largest, 1.0))
    whole = jnp.concatenate([matrix, right[:, None]], axis=1) / scale

    def without_column(k: Int[Array, ""], left: Array) -> Array:
        """With column k reduced to one entry, in row k."""
        pivot = jnp.argmax(jnp.where(rows >= k, jnp.abs(left[:, k]), -1.0))
        left = left[rows.at[k].set(pivot).at[pivot].set(k)]
        row = left[k] / left[k, k]
        reduced = left - left[:, k, None] * row
        return reduced.at[k].set(row)

    return jax.lax.fori_loop(0, size, without_column, whole)[:, size]
