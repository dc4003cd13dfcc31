"""A muscle that lifts a mass off its base: lift-off and rest, in closed form."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.muscle import McKibben

Value = Float[Array, "..."]


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
