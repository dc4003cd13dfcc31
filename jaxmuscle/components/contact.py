"""One-sided contact: bodies that press but do not pull, muscles that pull but do not push, hard stops."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Value = Float[Array, "..."]
Sides = tuple[Bool[Array, "..."], Bool[Array, "..."]]
"""Whether something is at its lower and at its upper stop."""

NEAR = 1e-12
"""What is nearer to a stop than this is at it, and what leaves it slower than this rests there: more than
rounding leaves, less than matters [m or rad; m/s or rad/s]."""


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


def tension(force: Value) -> Value:
    """Tension of something that goes slack rather than push, max(F, 0) [N].

    At F = 0, an empty muscle, the slope is the one towards tension, so that pressure is seen to act.
    """
    return jnp.where(force < 0, 0.0, force)


def stopped(
    position: Value, velocity: Value, lowest: Array | float, highest: Array | float
) -> tuple[Value, Value]:
    """Position and velocity after hard inelastic stops have acted: none outside, none outwards at a stop."""
    below, above = at_stops(position, lowest, highest)
    within = jnp.where(below, lowest, jnp.where(above, highest, position))
    caught = (below & (velocity <= NEAR)) | (above & (velocity >= -NEAR))
    return within, jnp.where(caught, 0.0, velocity)


def at_stops(position: Value, lowest: Array | float, highest: Array | float) -> Sides:
    """Whether something has reached its lower and its upper stop."""
    return position <= lowest + NEAR, position >= highest - NEAR


def stopped_acceleration(
    acceleration: Value, position: Value, lowest: Array | float, highest: Array | float
) -> Value:
    """Acceleration between the stops of :func:`stopped`: none into a stop that has been reached."""
    # Else XLA computes all that leads to the acceleration once for each use of it: a third slower in a batch.
    acceleration = jax.lax.optimization_barrier(acceleration)
    below, above = at_stops(position, lowest, highest)
    return jnp.where((below & (acceleration < 0)) | (above & (acceleration > 0)), 0.0, acceleration)
