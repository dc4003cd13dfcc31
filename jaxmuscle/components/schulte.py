"""The McKibben muscle described by its thread, as Schulte and Chou and Hannaford do."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.muscle import McKibben
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class ThreadMuscle(eqx.Module):
    r"""The same muscle as :class:`McKibben`, with the braid's thread in place of radius and angle.

    A thread of length b winds n times around the muscle: :math:`\cosα_0 = l_0/b`,
    :math:`r_0 = b \sinα_0/(2πn)`. It has the fields and methods of `McKibben` that rigs and effects use,
    so either can stand in any rig. Valid for l0 < b and 0 ≤ kε < 1.
    """

    initial_length: Scalar = parameter("m", "active length at rest", positive=True)
    thread_length: Scalar = parameter("m", "length of one thread of the braid", positive=True)
    turns: Scalar = parameter("", "turns of a thread around the muscle", positive=True)
    end_factor: Scalar = parameter("", "conic-end factor on the contraction ratio", positive=True)

    @property
    def braid_angle(self) -> Scalar:
        """Braid angle at rest α0 [rad]."""
        return jnp.arccos(self.initial_length / self.thread_length)

    @property
    def initial_radius(self) -> Scalar:
        """Radius at rest r0 [m]."""
        return 0.5 * self.braid_diameter * jnp.sin(self.braid_angle)

    @property
    def braid_diameter(self) -> Scalar:
        r"""Diameter the braid would have at an angle of 90°: :math:`D_{90} = b/(nπ)` [m]."""
        return self.thread_length / (self.turns * jnp.pi)

    def strain(self, contraction: Value) -> Value:
        """Contraction ratio ε = contraction / l0 [-]; contraction in m."""
        return contraction / self.initial_length

    def force(self, contraction: Value, gauge_pressure: Value, end_factor: Value) -> Value:
        r"""Static force, [T] equation 6: :math:`F = (π D_{90}^2/4)\,P\,(3\cos^2α - 1)`,
        :math:`\cosα = (1 - kε)\,l_0/b`.

        Args: contraction [m], gauge_pressure P [Pa], end_factor k [-]. Returns tension [N].
        """
        cosine = (1 - end_factor * self.strain(contraction)) * self.initial_length / self.thread_length
        return jnp.pi / 4 * self.braid_diameter**2 * gauge_pressure * (3 * cosine**2 - 1)

    def volume(self, contraction: Value) -> Value:
        r"""Cylinder under the braid: :math:`V = b^3/(4πn^2)\,\sin^2α\,\cosα`, Chou and Hannaford (1996).

        Contraction [m]; volume [m^3].
        """
        cosine = (self.initial_length - contraction) / self.thread_length
        scale = self.thread_length**3 / (4 * jnp.pi * self.turns**2)
        return scale * (1 - cosine**2) * cosine

    def volume_slope(self, contraction: Value) -> Value:
        """dV/dx of :meth:`volume` in closed form [m^2]; contraction x [m]."""
        return self.force(contraction, jnp.asarray(1.0), jnp.asarray(1.0))

    def swelling(self, length_ratio: Value) -> Value:
        """Radius ratio r / r0 at a length ratio l / l0, as :meth:`McKibben.swelling`."""
        return self.described_by_angle().swelling(length_ratio)

    def contact_surface(self, contraction: Value) -> Value:
        """Thread-on-thread contact surface [m^2], as :meth:`McKibben.contact_surface`."""
        return self.described_by_angle().contact_surface(contraction)

    def described_by_angle(self) -> McKibben:
        """The same muscle by its radius and braid angle."""
        return McKibben(self.initial_length, self.initial_radius, self.braid_angle, self.end_factor)


def described_by_thread(muscle: McKibben) -> ThreadMuscle:
    r"""The same muscle by its thread: :math:`b = l_0/\cosα_0`, :math:`n = b \sinα_0/(2π r_0)`."""
    thread_length = muscle.initial_length / jnp.cos(muscle.braid_angle)
    turns = thread_length * jnp.sin(muscle.braid_angle) / (2 * jnp.pi * muscle.initial_radius)
    return ThreadMuscle(muscle.initial_length, thread_length, turns, muscle.end_factor)
