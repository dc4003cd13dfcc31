"""Rigid-body dynamics of two links in a plane with a payload at the tip, dry friction and hard stops at two
joints whose motions are coupled through the mass matrix.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.cylinder import NEAR, Sides, at_stops
from jaxmuscle.effects.slip import Bristle, force_to_rest, reach, softening
from jaxmuscle.parameters import Scalar, parameter

Joints = Float[Array, "... 2"]


class RigidLink(eqx.Module):
    """One link: its length, and its mass as a mass point and a moment of inertia about that point."""

    length: Scalar = parameter(
        "m", "distance from the link's joint to the next one or to the tip", positive=True
    )
    mass: Scalar = parameter("kg", "mass of the link", positive=True)
    centre: Scalar = parameter("m", "distance of the centre of mass from the link's joint", positive=True)
    inertia: Scalar = parameter("kg m^2", "moment of inertia about the centre of mass", positive=True)

    @property
    def first_moment(self) -> Scalar:
        """Mass times distance of the centre from the joint [kg m]."""
        return self.mass * self.centre

    @property
    def inertia_about_joint(self) -> Scalar:
        """Moment of inertia about the link's joint [kg m^2]."""
        return self.inertia + self.mass * self.centre**2


def rod(length: float, mass: float, end_mass: float = 0.0) -> RigidLink:
    """A uniform rod of `mass` [kg] and `length` [m] with a further point mass [kg] at its far end."""
    whole = mass + end_mass
    centre = (0.5 * mass + end_mass) * length / whole
    inertia = (mass / 3 + end_mass) * length**2 - whole * centre**2
    return RigidLink(*map(jnp.asarray, (length, whole, centre, inertia)))


def solved(mass_matrix: Float[Array, "... 2 2"], right: Joints) -> Joints:
    """M⁻¹ b of a mass matrix and a vector of two, written out."""
    m11, m12, m22 = mass_matrix[..., 0, 0], mass_matrix[..., 0, 1], mass_matrix[..., 1, 1]
    b1, b2 = jnp.moveaxis(right, -1, 0)
    determinant = m11 * m22 - m12**2
    return jnp.stack([m22 * b1 - m12 * b2, m11 * b2 - m12 * b1], -1) / determinant[..., None]


class Arm(eqx.Module):
    r"""Two links in a plane: :math:`M(q)\,\ddot q + h(q, \dot q) = τ`.

    q1 is the angle of the first link from the x-axis, q2 that of the second from the first; τ are the
    torques at the joints. The plane is horizontal unless `gravity`, which acts along -y, is given.
    The payload is a mass point at the tip.
    """

    first: RigidLink
    second: RigidLink
    payload: Scalar = parameter("kg", "mass carried at the tip", default=0.0, nonnegative=True)
    gravity: Scalar = parameter(
        "m/s^2", "gravity in the plane of the arm, along -y", default=0.0, typical=9.8
    )

    @property
    def _outer(self) -> tuple[Scalar, Scalar, Scalar]:
        """Mass, first moment and moment of inertia of second link and payload about the second joint."""
        link, tip = self.second, self.payload * self.second.length
        return (
            link.mass + self.payload,
            link.first_moment + tip,
            link.inertia_about_joint + tip * link.length,
        )

    def mass_matrix(self, angle: Joints) -> Float[Array, "... 2 2"]:
        r"""Mass matrix M [kg m^2]; angle [rad].

        .. math:: M_{22} = δ,\; M_{12} = δ + l_1 h \cos q_2,\; M_{11} = J_1 + m l_1^2 + δ + 2 l_1 h \cos q_2

        with m, h, δ mass, first moment and inertia of everything beyond the second joint about that joint,
        and J1 the inertia of the first link about its joint.
        """
        mass, moment, inertia = self._outer
        coupling = self.first.length * moment * jnp.cos(angle[..., 1])
        both = inertia + coupling
        outer = jnp.broadcast_to(inertia, both.shape)
        base = self.first.inertia_about_joint + mass * self.first.length**2
        return jnp.stack(
            [jnp.stack([base + both + coupling, both], -1), jnp.stack([both, outer], -1)], axis=-2
        )

    def bias(self, angle: Joints, velocity: Joints) -> Joints:
        r"""Torques h that hold the arm to constant joint velocities [N m]: Coriolis, centrifugal, weight.

        .. math:: h_1 = -l_1 h \sin q_2\,\dot q_2 (2 \dot q_1 + \dot q_2) + g [(m_1 c_1 + m l_1) \cos q_1
                  + h \cos(q_1 + q_2)],\quad h_2 = l_1 h \sin q_2\,\dot q_1^2 + g\,h \cos(q_1 + q_2)
        """
        mass, moment, _ = self._outer
        w1, w2 = velocity[..., 0], velocity[..., 1]
        swirl = self.first.length * moment * jnp.sin(angle[..., 1])
        outer = self.gravity * moment * jnp.cos(angle.sum(-1))
        inner = self.gravity * (self.first.first_moment + mass * self.first.length) * jnp.cos(angle[..., 0])
        return jnp.stack([-swirl * w2 * (2 * w1 + w2) + inner + outer, swirl * w1**2 + outer], axis=-1)

    def acceleration(self, angle: Joints, velocity: Joints, torque: Joints) -> Joints:
        r"""Forward dynamics :math:`\ddot q = M^{-1} (τ - h)` [rad/s^2], the 2 × 2 inverse written out."""
        return solved(self.mass_matrix(angle), torque - self.bias(angle, velocity))

    def torque(self, angle: Joints, velocity: Joints, acceleration: Joints) -> Joints:
        r"""Inverse dynamics :math:`τ = M \ddot q + h` [N m]."""
        inertial = jnp.einsum("...ij,...j->...i", self.mass_matrix(angle), acceleration)
        return inertial + self.bias(angle, velocity)

    def energy(self, angle: Joints, velocity: Joints) -> Float[Array, "..."]:
        """Kinetic and potential energy [J], the latter zero where both links lie along the x-axis."""
        mass, moment, _ = self._outer
        kinetic = 0.5 * jnp.einsum("...i,...ij,...j->...", velocity, self.mass_matrix(angle), velocity)
        inner = (self.first.first_moment + mass * self.first.length) * jnp.sin(angle[..., 0])
        return kinetic + self.gravity * (inner + moment * jnp.sin(angle.sum(-1)))


LEAST_LIMIT = 1e-9
"""In place of a dry friction of none, where bristles need one [N m]."""
Pair = Float[Array, "2"]
Matrix = Float[Array, "2 2"]


def coupled_slip(
    driving: Pair,
    velocity: Pair,
    limit: Pair,
    mass_matrix: Matrix,
    widening: Array | float | None = None,
    stops: Sides | None = None,
    bristle: Bristle | None = None,
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
        bristle: how far the friction of each joint has built up; `None` where it acts at once.
    """
    wanted = force_to_rest(driving, mass_matrix @ velocity, widening)
    most = jnp.ones(2)
    if bristle is not None:
        own = mass_matrix
        wanted, mass_matrix = _on_bristles(wanted, limit, own, bristle, widening)
        most = reach(bristle, limit / jnp.diagonal(own), widening)
    resistance, unlimited = _nearest(wanted, _box(most * limit, stops), mass_matrix)
    some = limit > 0
    share = jnp.clip(resistance / jnp.where(some, limit, 1.0), -most, most)
    return jnp.where(some, share, jnp.sign(unlimited))


def _on_bristles(
    wanted: Pair, limit: Pair, mass_matrix: Matrix, bristle: Bristle, widening: Array | float | None
) -> tuple[Pair, Matrix]:
    r"""Force to rest and mass matrix of two joints whose friction builds up on bristles.

    With :math:`E = \mathrm{diag}(δ/(τ T (1 - z s)))`, S/m of :func:`slip_of_mass`, and z the share that has
    built up, :math:`\bar M = (M^{-1} + E L^{-1})^{-1}` takes the place of M and
    :math:`\bar M (M^{-1} b + E z)` that of b.
    """
    distance = bristle.distance
    some = jnp.where(limit > 0, limit, LEAST_LIMIT)
    sense = jnp.sign(solved(mass_matrix, wanted - some * bristle.share))
    each = softening(bristle, some / jnp.diagonal(mass_matrix), sense, widening)
    mobility = jnp.stack([solved(mass_matrix, unit) for unit in jnp.eye(2)], -1)
    softer = mobility + jnp.diag(each / some)
    force = solved(softer, mobility @ wanted + each * bristle.share)
    columns = [solved(softer, unit) for unit in jnp.eye(2)]
    # Exactly as without bristles at a distance of zero, where products would leave rounding.
    present = distance > 0
    return jnp.where(present, force, wanted), jnp.where(present, jnp.stack(columns, -1), mass_matrix)


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
