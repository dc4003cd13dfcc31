"""Rigid-body dynamics of two links in a plane, with a payload at the tip."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

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
