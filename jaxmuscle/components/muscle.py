"""The McKibben muscle of Tondu and Lopez [T]: force, volume and thread contact surface."""

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
