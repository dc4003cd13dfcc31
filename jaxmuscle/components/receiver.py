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
