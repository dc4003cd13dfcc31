"""A double-acting cylinder with a leaky piston."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.gas import GAS_CONSTANT, nozzle_flow
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]
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
