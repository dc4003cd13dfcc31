"""Double-acting cylinder with a leaky piston, a piston that slides between the cylinder's end and a
stopper, and unilateral contact: bodies that press but do not pull, muscles that pull but do not push, hard
stops.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxmuscle.components.gas import GAS_CONSTANT, nozzle_flow
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]
Sides = tuple[Bool[Array, "..."], Bool[Array, "..."]]
"""Whether something is at its lower and at its upper stop."""

NEAR = 1e-12
"""What is nearer to a stop than this is at it, and what leaves it slower than this rests there: more than
rounding leaves, less than matters [m or rad; m/s or rad/s]."""


def positive_part(value: Array, width: Array | float) -> Array:
    r"""max(value, 0) with its corner rounded to :math:`(x + w)^2/(4w)` in :math:`|x| < w`; never negative."""
    inside = jnp.clip(value, -width, width)
    return (inside + width) ** 2 / (4 * width) + jnp.maximum(value - width, 0.0)


def pressing(depth: Value, speed: Value, stiffness: Value, damping: Value, width: Array | float) -> Value:
    r"""Contact force :math:`F = K\,(δ)_+\,(1 + c\,\dot δ)_+` [N].

    Hunt and Crossley, J. Appl. Mech. 42, 1975. Both positive parts are rounded (:func:`positive_part`), so
    that F is continuous with its slope and never pulls.

    Args:
        depth, speed: penetration δ [m] and its rate [m/s].
        stiffness, damping: K [N/m] and c [s/m].
        width: penetration over which contact sets in [m].
    """
    return stiffness * positive_part(depth, width) * positive_part(1 + damping * speed, 0.1)


def tension(force: Value) -> Value:
    """Tension of something that goes slack rather than push, max(F, 0) [N].

    At F = 0, an empty muscle, the slope is the one towards tension, so that pressure is seen to act.
    """
    return jnp.where(force < 0, 0.0, force)


def stopped(
    position: Value, velocity: Value, lowest: Array | float, highest: Array | float
) -> tuple[Value, Value]:
    """Position and velocity after hard inelastic stops have acted: none outside, none outwards at a stop."""
    below, above = at_stops(position, lowest, highest)
    within = jnp.where(below, lowest, jnp.where(above, highest, position))
    caught = (below & (velocity <= NEAR)) | (above & (velocity >= -NEAR))
    return within, jnp.where(caught, 0.0, velocity)


def at_stops(position: Value, lowest: Array | float, highest: Array | float) -> Sides:
    """Whether something has reached its lower and its upper stop."""
    return position <= lowest + NEAR, position >= highest - NEAR


def stopped_acceleration(
    acceleration: Value, position: Value, lowest: Array | float, highest: Array | float
) -> Value:
    """Acceleration between the stops of :func:`stopped`: none into a stop that has been reached."""
    # Else XLA computes all that leads to the acceleration once for each use of it: a third slower in a batch.
    acceleration = jax.lax.optimization_barrier(acceleration)
    below, above = at_stops(position, lowest, highest)
    return jnp.where((below & (acceleration < 0)) | (above & (acceleration > 0)), 0.0, acceleration)


Chambers = Float[Array, "2"]


class Cylinder(eqx.Module):
    """Two chambers on either side of a piston; chamber 1 grows with the piston's position.

    The position is that of the stopper on the rod, as in [H] 2.32: x_s = x_p + `stopper_length`. Valid
    while both volumes are above zero.
    """

    diameter: Scalar = parameter("m", "bore of the cylinder", default=15.875e-3, positive=True)
    free_length: Scalar = parameter("m", "length of the two chambers together", default=70e-3, positive=True)
    stopper_length: Scalar = parameter("m", "stopper position at which chamber 1 is empty", default=26e-3)
    leak_area: Scalar = parameter(
        "m^2", "leak past the piston at a pressure ratio of 0", default=0.0971e-6, nonnegative=True
    )
    leak_slope: Scalar = parameter(
        "m^2", "fall of the leak's area from a pressure ratio of 0 to 1", default=0.0475e-6
    )

    @property
    def piston_area(self) -> Value:
        """Area A_p of the piston [m^2]."""
        return 0.25 * jnp.pi * self.diameter**2

    def volumes(self, stopper: Value) -> Chambers:
        r""":math:`V_1 = A_p x_p,\ V_2 = A_p (L - x_p)` [m^3], [H] 2.30-2.31; stopper position [m]."""
        travel = stopper - self.stopper_length
        return self.piston_area * jnp.stack([travel, self.free_length - travel])

    def force(self, pressure: Chambers) -> Value:
        """Pull of the rod :math:`A_p (p_1 - p_2)` [N], [H] 2.34 and 2.36; pressures [Pa]."""
        return self.piston_area * (pressure[0] - pressure[1])

    def leak(self, pressure: Chambers, temperature: Value | Chambers) -> Value:
        r"""Flow past the piston from chamber 1 to chamber 2 [kg/s], [H] 2.23:
        :math:`C_d A = A_0 - A_1\,p_d/p_u`, not below zero, p_u and p_d the higher and the lower pressure.

        `leak_area` A_0, `leak_slope` A_1; pressures absolute [Pa], temperature, one or of each chamber [K].
        """
        pair = jnp.broadcast_to(temperature, (2,))
        upstream = jnp.where(pressure[0] >= pressure[1], pair[0], pair[1])
        ratio = jnp.min(pressure) / jnp.max(pressure)
        area = jnp.maximum(self.leak_area - self.leak_slope * ratio, 0.0)
        return nozzle_flow(area, pressure[0], pressure[1], upstream)

    def pressure_rate(
        self, mass_flow: Chambers, volume: Chambers, temperature: Value, exponent: Value
    ) -> Chambers:
        r""":math:`\dot p = n R T \dot m / V` [Pa/s] of chambers whose piston is held, [H] 2.29.

        Args: mass_flow [kg/s], volume [m^3], temperature [K], exponent n: 1 isothermal … 1.4 adiabatic.
        """
        return exponent * GAS_CONSTANT * temperature * mass_flow / volume


class Piston(eqx.Module):
    r"""Mass, spring, stops and friction of a piston at x_p from the end of its cylinder.

    .. math:: m \ddot x_p = A_p (p_1 - p_2) - F_{rod} + F_{end} - b \dot x_p - F_f,\quad
              F_{rod} = k_s (L_0 - g) + F_{stop},\quad g = x_s - L_p - L_s - L_{sup} - x_p

    [H] 2.32 to 2.38: the spring lies in the gap g between piston and stopper and keeps the rod taut; once
    the gap is closed the stopper carries the rest. Stops are stiff one-sided springs (:func:`pressing`),
    the stiffness that of rod and force sensor. The spring's solid length is neglected.
    """

    mass: Scalar = parameter(
        "kg", "mass of the piston and of what moves with it", default=0.02, positive=True
    )
    spring_rate: Scalar = parameter("N/m", "rate of the spring", default=88.14, nonnegative=True)
    spring_length: Scalar = parameter("m", "unloaded length of the spring", default=69.1e-3, positive=True)
    viscous: Scalar = parameter("N s/m", "viscous friction b", default=0.0, nonnegative=True, typical=1.0)
    coulomb_force: Scalar = parameter("N", "Coulomb friction F_c", default=0.0, nonnegative=True, typical=1.0)
    stiction_force: Scalar = parameter("N", "stiction F_s", default=0.0, nonnegative=True, typical=1.0)
    stiction_velocity: Scalar = parameter(
        "m/s", "velocity over which stiction turns into Coulomb friction", default=0.01, positive=True
    )
    # The thesis has rigid stops; how soft they are is a choice of this package.
    stop_stiffness: Scalar = parameter("N/m", "stiffness of the stops", default=2e5, positive=True)
    stop_damping: Scalar = parameter("s/m", "damping of the stops", default=2.0, nonnegative=True)
    stop_width: Scalar = parameter("m", "depth over which a stop sets in", default=5e-6, positive=True)

    def rod_force(self, gap: Value, velocity: Value) -> Value:
        """Pull on the rod F_rod [N], [H] 2.37-2.38; gap g to the stopper [m], piston's velocity [m/s]."""
        stop = pressing(-gap, velocity, self.stop_stiffness, self.stop_damping, self.stop_width)
        return self.spring_rate * (self.spring_length - gap) + stop

    def end_force(self, position: Value, velocity: Value) -> Value:
        """Push of the cylinder's end F_end [N]; position x_p [m], velocity [m/s]."""
        return pressing(-position, -velocity, self.stop_stiffness, self.stop_damping, self.stop_width)

    def viscous_force(self, velocity: Value) -> Value:
        """Viscous friction b ẋ_p [N], [H] 2.33."""
        return self.viscous * velocity

    def dry_limit(self, velocity: Value) -> Value:
        r"""Largest dry friction :math:`F_c + (F_s - F_c)\,e^{-|\dot x_p|/v_s}` [N]: [H] 2.35, smooth.

        [H] jumps from F_s to F_c as the piston starts; here it falls over v_s, `stiction_velocity`.
        """
        fading = jnp.exp(-jnp.abs(velocity) / self.stiction_velocity)
        return self.coulomb_force + (self.stiction_force - self.coulomb_force) * fading
