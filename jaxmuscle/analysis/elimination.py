"""Small linear systems, solved without LAPACK.

Batched LAPACK kernels of jaxlib spread over the very threads that run the computation and wait there. Two of
them in one computation, such as the eigenvalues and the frequency responses of many linear models, wait for
each other for ever where there are two cores (seen with jaxlib 0.10).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Inexact, Int


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
