"""McKibben muscle of Tondu and Lopez [T], the same muscle described by its thread (Schulte, Chou and
Hannaford), and the closed forms of a muscle that lifts a mass.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]

LEAST_RATIO, LEAST_SINE = 0.01, 0.01
"""Where the thread surface stops to grow: 1 - kε, and the sine of the braid angle [-]."""


class McKibben(eqx.Module):
    r"""Ideal cylindrical muscle with constant conic ends.

    Symbols of [T]: `initial_length` l0, `initial_radius` r0, `braid_angle` α0, `end_factor` k, and
    ε = contraction / l0. Valid for 0 ≤ kε < 1 and braid angles below 54.7°.
    """

    initial_length: Scalar = parameter("m", "active length at rest", positive=True)
    initial_radius: Scalar = parameter("m", "radius at rest", positive=True)
    braid_angle: Scalar = parameter("rad", "braid angle at rest, from the axis", positive=True)
    end_factor: Scalar = parameter("", "conic-end factor on the contraction ratio", positive=True)

    def strain(self, contraction: Value) -> Value:
        """Contraction ratio ε = contraction / l0 [-]; contraction in m."""
        return contraction / self.initial_length

    def force(self, contraction: Value, gauge_pressure: Value, end_factor: Value) -> Value:
        r"""Static force, [T] equations 4, 5 and 7 (5: its largest value, at ε = 0):
        :math:`F = π r_0^2 P\,[a (1 - kε)^2 - b]`, :math:`a = 3/\tan^2α_0`, :math:`b = 1/\sin^2α_0`.

        Args: contraction [m], gauge_pressure P [Pa], end_factor k [-]. Returns tension [N].
        """
        a = 3 / jnp.tan(self.braid_angle) ** 2
        b = 1 / jnp.sin(self.braid_angle) ** 2
        shortened = 1 - end_factor * self.strain(contraction)
        return jnp.pi * self.initial_radius**2 * gauge_pressure * (a * shortened**2 - b)

    def swelling(self, length_ratio: Value) -> Value:
        r"""Radius ratio, [T] equation 3: :math:`r/r_0 = \sqrt{1 - \cos^2α_0 (l/l_0)^2}/\sinα_0`."""
        return self._sine(length_ratio) / jnp.sin(self.braid_angle)

    def volume(self, contraction: Value) -> Value:
        r"""Plain cylinder, [T] equation 3: :math:`V = π r^2 l`, :math:`l = l_0 (1 - ε)`,
        :math:`r = r_0 \sqrt{1 - \cos^2α_0 (1 - ε)^2}/\sinα_0`. Contraction [m]; volume [m^3].
        """
        ratio = 1 - self.strain(contraction)
        radius_squared = self.initial_radius**2 * self._sine_squared(ratio) / jnp.sin(self.braid_angle) ** 2
        return jnp.pi * radius_squared * self.initial_length * ratio

    def volume_slope(self, contraction: Value) -> Value:
        """dV/dx of :meth:`volume` in closed form [m^2]; contraction x [m]."""
        ratio = 1 - self.strain(contraction)
        cos_squared = jnp.cos(self.braid_angle) ** 2
        scale = jnp.pi * self.initial_radius**2 / jnp.sin(self.braid_angle) ** 2
        return -scale * (1 - 3 * cos_squared * ratio**2)

    def contact_surface(self, contraction: Value) -> Value:
        r"""Thread-on-thread contact surface, [T] equations 13 and 14:
        :math:`S = 2π r_0 l_0 \sinα_0 / [(1-kε)\sqrt{1 - \cos^2α_0 (1-kε)^2}]`.

        Contraction [m]; surface [m^2].
        """
        # Kept from zero, where the law has a pole, for slack muscles that are folded up beyond kε = 1.
        ratio = jnp.maximum(1 - self.end_factor * self.strain(contraction), LEAST_RATIO)
        scale = 2 * jnp.pi * self.initial_radius * self.initial_length * jnp.sin(self.braid_angle)
        return scale / (ratio * self._sine(ratio))

    def _sine_squared(self, ratio: Value) -> Value:
        """sin² of the braid angle at the given length ratio: 1 - cos²α0 (l/l0)²."""
        return 1 - jnp.cos(self.braid_angle) ** 2 * ratio**2

    def _sine(self, ratio: Value) -> Value:
        """Sine of the braid angle; a little above zero for a muscle longer than its threads."""
        return jnp.sqrt(jnp.maximum(self._sine_squared(ratio), LEAST_SINE**2))


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


def largest_contraction(muscle: McKibben) -> Value:
    r"""Contraction at which the force vanishes, [T] equations 5 and 8 [m]:
    :math:`ε_{max} l_0/k`, :math:`ε_{max} = 1 - 1/(\sqrt3 \cosα_0)`.
    """
    return muscle.initial_length * (1 - 1 / (jnp.sqrt(3.0) * jnp.cos(muscle.braid_angle))) / muscle.end_factor


def lift_off_pressure(muscle: McKibben, weight: Value, static_coefficient: Value) -> Value:
    r"""Gauge pressure at which a load leaves its base, the first line of [T] equation 18 [Pa].

    .. math:: F_{dyn}(ε = 0, \dot x = 0) = m g \;⇒\; P = \frac{m g}{π r_0^2 (a - b) - (f_s/n)\,S(0)}

    Both the force and the static friction (equation 15) are proportional to P.

    Args:
        weight: m g [N].
        static_coefficient: f_s/n [-]; 0 for a muscle without friction.
    """
    none = jnp.zeros_like(weight)
    force = muscle.force(none, jnp.asarray(1.0), muscle.end_factor)
    return weight / (force - static_coefficient * muscle.contact_surface(none))


def isotonic_contraction(muscle: McKibben, weight: Value, gauge_pressure: Value) -> Value:
    r"""Contraction at which a muscle without friction carries a load [m], [T] equations 4 and 7 solved for ε.

    .. math:: ε = \frac1k \left[1 - \sqrt{\frac1a\left(\frac{m g}{π r_0^2 P} + b\right)}\right]

    Negative while the pressure is too low for the load to be lifted.

    Args:
        weight: m g [N].
        gauge_pressure: P [Pa], above zero.
    """
    a = 3 / jnp.tan(muscle.braid_angle) ** 2
    b = 1 / jnp.sin(muscle.braid_angle) ** 2
    carried = weight / (jnp.pi * muscle.initial_radius**2 * gauge_pressure)
    return muscle.initial_length * (1 - jnp.sqrt((carried + b) / a)) / muscle.end_factor
