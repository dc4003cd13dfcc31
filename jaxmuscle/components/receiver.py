"""The receiver plate of a jet-pipe valve: two ports, supplied by the jet or open to the outlet."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.components.overlap import circle_overlap
from jaxmuscle.parameters import Scalar, parameter

SIDES = np.array([1.0, -1.0])
"""Side of the middle on which each control port lies; a tip towards a port supplies it."""
FLANGE = 3.0
"""Diameter of the flange around the tip, in diameters of a port."""

Value = Float[Array, "..."]
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
        radius = 0.5 * self.port_diameter
        return circle_overlap(SIDES * position - self.port_diameter, radius, radius)

    def return_areas(self, position: Value) -> Ports:
        r"""Areas from ports 1 and 2 to the outlet, what the flange leaves open:
        :math:`A_r = π D^2/4 - A_∩(x ∓ D, D/2, 3D/2)` [m^2], [H] 2.8-2.17; position as above.
        """
        radius = 0.5 * self.port_diameter
        covered = circle_overlap(SIDES * position - self.port_diameter, radius, FLANGE * radius)
        return jnp.pi * radius**2 - covered

    def mass_flow(
        self, position: Value, pressure: Ports, ambient_pressure: Value, temperature: Value
    ) -> Ports:
        """Flows through ports 1 and 2 into the chambers [kg/s]: supply minus return, [H] 2.18-2.22.

        Args: position [m], pressure: of both chambers, absolute [Pa], temperature [K].
        """
        supply = self.discharge_coefficient * self.supply_areas(position)
        outlet = self.discharge_coefficient * self.return_areas(position)
        inflow = nozzle_flow(supply, self.supply_pressure, pressure, temperature)
        return inflow - nozzle_flow(outlet, pressure, ambient_pressure, temperature)
