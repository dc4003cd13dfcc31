"""Jet-pipe valve: a tube bent by a torque motor, whose tip swings over the two ports of a receiver plate."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.parameters import Scalar, parameter

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


SIDES = np.array([1.0, -1.0])
"""Side of the middle on which each control port lies; a tip towards a port supplies it."""
FLANGE = 3.0
"""Diameter of the flange around the tip, in diameters of a port."""
Ports = Float[Array, "2"]


class Receiver(eqx.Module):
    """Jet and two control ports of one diameter D, the ports at ±D; a flange of 3 D closes the other port."""

    discharge_coefficient: Scalar = parameter("", "discharge coefficient of the ports", positive=True)
    supply_pressure: Scalar = parameter("Pa", "supply pressure, absolute", positive=True)
    port_diameter: Scalar = parameter(
        "m", "diameter of the jet and of the ports", default=0.9652e-3, positive=True
    )

    def supply_areas(self, position: Value) -> Ports:
        r"""Areas from the jet to ports 1 and 2: :math:`A_s = A_∩(x ∓ D, D/2, D/2)` [m^2], [H] 2.8-2.17.

        Position x of the tip from the middle, positive towards port 1 [m].
        """
        return self.areas(position)[0]

    def return_areas(self, position: Value) -> Ports:
        r"""Areas from ports 1 and 2 to the outlet, what the flange leaves open:
        :math:`A_r = π D^2/4 - A_∩(x ∓ D, D/2, 3D/2)` [m^2], [H] 2.8-2.17; position as above.
        """
        return self.areas(position)[1]

    def areas(self, position: Value) -> Float[Array, "2 2"]:
        """Supply areas and return areas of ports 1 and 2 [m^2], in one look at the circles."""
        radius = 0.5 * self.port_diameter
        offset = SIDES * position - self.port_diameter
        covered = circle_overlap(offset, radius, radius * jnp.array([[1.0], [FLANGE]]))
        return jnp.stack([covered[0], jnp.pi * radius**2 - covered[1]])

    def mass_flow(
        self, position: Value, pressure: Ports, ambient_pressure: Value, temperature: Value
    ) -> Ports:
        """Flows through ports 1 and 2 into the chambers [kg/s]: supply minus return, [H] 2.18-2.25.

        Args: position [m], pressure: of both chambers, absolute [Pa], temperature [K].
        """
        inflow, outflow = self.streams(
            position, pressure, self.supply_pressure, ambient_pressure, temperature, temperature
        )
        return inflow - outflow

    def streams(
        self,
        position: Value,
        pressure: Ports,
        supply_pressure: Value,
        ambient_pressure: Value,
        outer_temperature: Value,
        temperature: Value,
    ) -> Float[Array, "2 2"]:
        """Flows from the supply into the chambers, and from the chambers to the outlet [kg/s], [H] 2.18-2.22.

        Args: position [m], pressures absolute [Pa], temperatures of supply and atmosphere and of the
        chambers [K]: each stream has that of where it comes from.
        """
        inner = jnp.broadcast_to(pressure, (2,))
        source = jnp.stack([jnp.broadcast_to(supply_pressure, (2,)), inner])
        sink = jnp.stack([inner, jnp.broadcast_to(ambient_pressure, (2,))])
        forward = jnp.array([[True], [False]])
        upstream = jnp.where((source >= sink) == forward, outer_temperature, temperature)
        return nozzle_flow(self.discharge_coefficient * self.areas(position), source, sink, upstream)


class JetPipe(eqx.Module):
    r"""From the coil's current to the position of the tip.

    Lag and resonance are those of [H] equation 2.6,

    .. math:: \frac{X}{X^s} = \frac{ω_1}{s + ω_1}\,\frac{ω_2^2}{s^2 + 2 ζ_2 ω_2 s + ω_2^2}

    Their state is (lagged position y, tip position x, tip velocity over ω2), all in m: of one size, which
    keeps the exponential of their matrix exact to rounding.
    """

    compliance: Scalar = parameter("m/N", "tip travel per newton at small forces", positive=True)
    saturation_force: Scalar = parameter("N", "tip force around which the travel saturates", positive=True)
    receiver_offset: Scalar = parameter("m", "offset of the receiver from the tip at rest")
    force_constant: Scalar = parameter("N/A", "tip force per ampere of coil", default=1.946, positive=True)
    lag_bandwidth: Scalar = parameter("rad/s", "bandwidth ω1 of the pipe's lag", default=973.9, positive=True)
    resonance: Scalar = parameter("rad/s", "undamped resonance ω2 of the pipe", default=1856.7, positive=True)
    damping: Scalar = parameter("", "damping ratio ζ2 of the resonance", default=0.019, positive=True)

    def tip_force(self, current: Value) -> Value:
        """Force on the tip :math:`F = k_m i` [N], [H] equation 2.4; current i [A]."""
        return self.force_constant * current

    def static_position(self, tip_force: Value) -> Value:
        r"""Tip position under a steady force F, the mid-line of the hysteresis loop ([H] equation 2.5):
        :math:`x^s = c F / (1 + (F/F_{sat})^4)^{1/4}` [m].

        `compliance` c, `saturation_force` F_sat; tip_force [N].
        """
        return self.compliance * tip_force / (1 + (tip_force / self.saturation_force) ** 4) ** 0.25

    def rate(self, static_position: Value, state: Float[Array, "3"]) -> Float[Array, "3"]:
        """Time derivative of the state (y, x, v/ω2) under a static tip position [m]."""
        lagged, tip, swing = state
        following = self.lag_bandwidth * (static_position - lagged)
        swinging = self.resonance * (lagged - tip - 2 * self.damping * swing)
        return jnp.stack([following, self.resonance * swing, swinging])

    def over_receiver(self, tip: Value) -> Value:
        """Position of the tip from the middle of the receiver: :math:`x = x_{jp} + x_{off}` [m], [H] 2.7."""
        return tip + self.receiver_offset
