"""Common area of two circles: a nozzle above a port, a flange above a port."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]


@jax.custom_jvp
def circle_overlap(offset: Value, radius: Value, other_radius: Value) -> Value:
    r"""Area common to two circles whose centres lie |offset| apart.

    .. math:: A = r^2 (α - \sin α \cos α) + R^2 (β - \sin β \cos β), \quad
              \cos α = \frac{d^2 + r^2 - R^2}{2 d r}, \quad \cos β = \frac{d^2 + R^2 - r^2}{2 d R}

    α and β are half the angles that the common chord spans in each circle; where the circles do not meet
    the cosines are held at ±1, which gives zero or the whole of the smaller circle. [H] section 2.5.

    The derivatives are those of the geometry: minus the chord with respect to the distance, the arc inside
    the other circle with respect to a radius. Finite everywhere, with no root to divide by: zero where the
    circles do not meet, and the one towards larger offsets where two equal circles lie on each other.

    Args:
        offset: signed distance d of the centres [m].
        radius, other_radius: r and R [m], above zero.

    Returns:
        area [m^2], broadcast over the arguments.
    """
    angle, other_angle = _half_angles(offset, radius, other_radius)
    return radius**2 * _segment(angle) + other_radius**2 * _segment(other_angle)


@circle_overlap.defjvp
def _circle_overlap_jvp(primals: tuple[Value, Value, Value], tangents: tuple[Value, Value, Value]):
    offset, radius, other_radius = primals
    angle, other_angle = _half_angles(*primals)
    chord = 2 * radius * jnp.sin(angle)
    slope = jnp.where(jnp.asarray(offset) < 0, chord, -chord)
    arc, other_arc = 2 * radius * angle, 2 * other_radius * other_angle
    tangent = slope * tangents[0] + arc * tangents[1] + other_arc * tangents[2]
    return circle_overlap(*primals), tangent


def _half_angles(offset: Value, radius: Value, other_radius: Value) -> tuple[Value, Value]:
    """Half the angles that the common chord spans in each circle, 0 … π."""
    distance = jnp.abs(offset)
    apart = distance > 0
    safe = jnp.where(apart, distance, 1.0)
    difference = (radius - other_radius) * (radius + other_radius)
    cosine = (safe**2 + difference) / (2 * safe * radius)
    other_cosine = (safe**2 - difference) / (2 * safe * other_radius)
    # Of concentric circles the smaller lies inside; equal ones share half a circle each.
    cosine = jnp.where(apart, cosine, jnp.sign(difference))
    other_cosine = jnp.where(apart, other_cosine, -jnp.sign(difference))
    return jnp.arccos(jnp.clip(cosine, -1.0, 1.0)), jnp.arccos(jnp.clip(other_cosine, -1.0, 1.0))


def _segment(angle: Value) -> Value:
    """Area of a segment of the unit circle that spans twice the angle."""
    return angle - jnp.sin(angle) * jnp.cos(angle)
