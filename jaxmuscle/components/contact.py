"""One-sided contact of bodies that can press but not pull."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]


def positive_part(value: Array, width: Array | float) -> Array:
    r"""max(value, 0) with its corner rounded to :math:`(x + w)^2/(4w)` in :math:`|x| < w`; never negative."""
    inside = jnp.clip(value, -width, width)
    return (inside + width) ** 2 / (4 * width) + jnp.maximum(value - width, 0.0)


def pressing(depth: Value, speed: Value, stiffness: Value, damping: Value, width: Array | float) -> Value:
    r"""Contact force :math:`F = K\,(δ)_+\,(1 + c\,\dot δ)_+` [N].

    Hunt and Crossley, J. Appl. Mech. 42, 1975. Both positive parts are rounded (:func:`positive_part`), so
    that F is continuous with its slope and never pulls.

    Args:
        depth, speed: penetration δ [m] and its rate [m/s].
        stiffness, damping: K [N/m] and c [s/m].
        width: penetration over which contact sets in [m].
    """
    return stiffness * positive_part(depth, width) * positive_part(1 + damping * speed, 0.1)
