"""Rounding of what a sensor or a converter resolves."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


def quantised(value: Array, size: ArrayLike) -> Array:
    """A value rounded to whole multiples of a size; as it is where the size is 0.

    Rounding lets derivatives pass as if there were none: its own slope is zero almost everywhere.
    """
    some = jnp.asarray(size) > 0
    safe = jnp.where(some, size, 1.0)
    error = jnp.where(some, safe * jnp.round(value / safe) - value, 0.0)
    return value + jax.lax.stop_gradient(error)
