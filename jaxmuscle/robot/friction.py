"""Dry friction at two joints whose motions are coupled through the mass matrix."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.effects.base import force_to_rest

Pair = Float[Array, "2"]


def coupled_slip(
    driving: Pair,
    velocity: Pair,
    limit: Pair,
    mass_matrix: Float[Array, "2 2"],
    widening: Array | float | None = None,
) -> Pair:
    r"""Slip of each joint, from -1 to 1, under dry friction: :func:`slip_of_mass` for two joints.

    With :math:`b = F + M v/τ` the friction f is the point of the box :math:`|f_i| ≤ L_i` that is nearest
    to b in the norm of :math:`M^{-1}`. Then each joint either sticks (it comes to rest within τ whatever
    the other one does) or slides with friction at its limit against its motion. Treating the joints one by
    one would let a sticking joint be dragged along by the acceleration of a sliding one.

    The box has two sides, so the nearest point is found by cases. With :math:`u = M^{-1} (b - f)`, f1 is at
    the limit whose sign u1 has when f1 is there and f2 is the best for it, and makes u1 zero otherwise.

    Args:
        driving: torques F without dry friction, Coriolis terms and weight taken off [N m].
        velocity: v [rad/s].
        limit: L, not negative [N m]; a joint at 0 has the sign of its motion as its slip.
        mass_matrix: M [kg m^2].
        widening: factor of τ, as in :func:`slip_of_mass`.
    """
    wanted = force_to_rest(driving, mass_matrix @ velocity, widening)
    m11, m12, m22 = mass_matrix[0, 0], mass_matrix[0, 1], mass_matrix[1, 1]
    b1, b2 = wanted[0], wanted[1]
    l1, l2 = limit[0], limit[1]

    def second(f1: Array) -> Array:
        """Best f2 for a given f1, before it is limited: that for which u2 = 0."""
        return b2 - m12 / m11 * (b1 - f1)

    def first_motion(f1: Array) -> Array:
        """u1, times the determinant of M."""
        return m22 * (b1 - f1) - m12 * (b2 - jnp.clip(second(f1), -l2, l2))

    forward, backward = first_motion(l1) >= 0, first_motion(-l1) <= 0
    # Joint 1 sticks: u1 = 0, and joint 2 feels its own inertia alone.
    sticking = b1 - m12 / m22 * (b2 - jnp.clip(b2, -l2, l2))
    s1 = jnp.where(forward, 1.0, jnp.where(backward, -1.0, sticking / _divisor(l1)))
    wanted_2 = second(l1 * s1)
    s2 = jnp.where(l2 > 0, jnp.clip(wanted_2 / _divisor(l2), -1.0, 1.0), jnp.sign(wanted_2))
    return jnp.stack([s1, s2])


def _divisor(limit: Array) -> Array:
    return jnp.where(limit > 0, limit, 1.0)
