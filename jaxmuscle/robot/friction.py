"""Dry friction and hard stops at two joints whose motions are coupled through the mass matrix."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.contact import NEAR, Sides, at_stops
from jaxmuscle.effects.base import force_to_rest
from jaxmuscle.robot.arm import solved

Pair = Float[Array, "2"]
Matrix = Float[Array, "2 2"]


def coupled_slip(
    driving: Pair,
    velocity: Pair,
    limit: Pair,
    mass_matrix: Matrix,
    widening: Array | float | None = None,
    stops: Sides | None = None,
) -> Pair:
    r"""Slip of each joint, from -1 to 1, under dry friction: :func:`slip_of_mass` for two joints.

    With :math:`b = F + M v/τ` the friction f is the point of the box :math:`|f_i| ≤ L_i` that is nearest
    to b in the norm of :math:`M^{-1}`. Then each joint either sticks (it comes to rest within τ whatever
    the other one does) or slides with friction at its limit against its motion. Treating the joints one by
    one would let a sticking joint be dragged along by the acceleration of a sliding one. A joint at a
    stop does not leave it for a push: towards the stop the box has no end, and friction takes of the
    resistance there what it can.

    Args:
        driving: torques F without dry friction, Coriolis terms and weight taken off [N m].
        velocity: v [rad/s].
        limit: L, not negative [N m]; a joint at 0 has the sign of its motion as its slip.
        mass_matrix: M [kg m^2].
        widening: factor of τ, as in :func:`slip_of_mass`.
        stops: which joints are at a stop; none when `None`.
    """
    wanted = force_to_rest(driving, mass_matrix @ velocity, widening)
    resistance, unlimited = _nearest(wanted, _box(limit, stops), mass_matrix)
    some = limit > 0
    share = jnp.clip(resistance / jnp.where(some, limit, 1.0), -1.0, 1.0)
    return jnp.where(some, share, jnp.sign(unlimited))


def between_stops(
    angle: Pair, velocity: Pair, lowest: Array, highest: Array, mass_matrix: Matrix
) -> tuple[Pair, Pair]:
    r"""Angles and velocities of two coupled joints after hard inelastic stops have acted.

    The impulses :math:`p` of the stops, towards the inside alone, leave the velocities
    :math:`v - M^{-1} p` that are nearest to v in the norm of M among those that lead no joint outwards
    (Moreau's inelastic impact, 1988): the other joint feels the blow.
    """
    stops = at_stops(angle, lowest, highest)
    # Else a velocity that is nothing but rounding leaves the stop, and no push brings it to rest there.
    velocity = jnp.where((stops[0] | stops[1]) & (jnp.abs(velocity) < NEAR), 0.0, velocity)
    impulse = _nearest(mass_matrix @ velocity, _box(jnp.zeros(2), stops), mass_matrix)[0]
    after = velocity - solved(mass_matrix, impulse)
    within = jnp.where(stops[0], lowest, jnp.where(stops[1], highest, angle))
    return within, jnp.where(impulse != 0, 0.0, after)


def stop_torque(torque: Pair, stops: Sides, mass_matrix: Matrix) -> Pair:
    r"""Torques r with which stops resist: none, or what keeps :math:`M^{-1} (F - r)` from leading outwards.

    Args:
        torque: F, all other torques, friction included, Coriolis terms and weight taken off [N m].
        stops: which joints are at a stop; the others have r = 0.
    """
    return _nearest(torque, _box(jnp.zeros(2), stops), mass_matrix)[0]


def _box(limit: Pair, stops: Sides | None) -> tuple[Pair, Pair]:
    """Lowest and highest resistance: the dry friction's, without an end towards a stop."""
    if stops is None:
        return -limit, limit
    return jnp.where(stops[0], -jnp.inf, -limit), jnp.where(stops[1], jnp.inf, limit)


def _nearest(wanted: Pair, box: tuple[Pair, Pair], mass_matrix: Matrix) -> tuple[Pair, Pair]:
    r"""The point f of a box that is nearest to b in the norm of :math:`M^{-1}`, and that before its limits.

    The box has two sides, so the point is found by cases. With :math:`u = M^{-1} (b - f)`, f1 is at the
    limit whose sign u1 has when f1 is there and f2 is the best for it, and makes u1 zero otherwise.
    A joint at rest that nothing pushes has the slopes of one that rests against its stop, if it has one.
    """
    m11, m12, m22 = mass_matrix[0, 0], mass_matrix[0, 1], mass_matrix[1, 1]
    b1, b2 = wanted[0], wanted[1]
    (low1, low2), (high1, high2) = box

    def second(f1: Array) -> Array:
        """Best f2 for a given f1, before it is limited: that for which u2 = 0."""
        return b2 - m12 / m11 * (b1 - f1)

    def first_motion(f1: Array) -> Array:
        """u1, times the determinant of M."""
        return m22 * (b1 - f1) - m12 * (b2 - _limited(second(f1), low2, high2))

    up, down = jnp.isfinite(high1), jnp.isfinite(low1)
    forwards, backwards = (first_motion(jnp.where(some, f, 0.0)) for some, f in ((up, high1), (down, low1)))
    forward = up & ((forwards > 0) | ((forwards == 0) & down))
    backward = down & ((backwards < 0) | ((backwards == 0) & up))
    # Joint 1 sticks: u1 = 0, and joint 2 feels its own inertia alone.
    sticking = b1 - m12 / m22 * (b2 - _limited(b2, low2, high2))
    f1 = jnp.where(forward, high1, jnp.where(backward, low1, sticking))
    return jnp.stack([f1, _limited(second(f1), low2, high2)]), jnp.stack([sticking, second(f1)])


def _limited(value: Array, low: Array, high: Array) -> Array:
    """`value` within limits; on one it has the slope of the limit, but its own where the other is open."""
    below = (value < low) | ((value == low) & jnp.isfinite(high))
    above = (value > high) | ((value == high) & jnp.isfinite(low))
    return jnp.where(below, low, jnp.where(above, high, value))
