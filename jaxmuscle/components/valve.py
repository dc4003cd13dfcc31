"""A proportional flow valve between a supply, a muscle and the atmosphere."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class FlowValve(eqx.Module):
    """Spool valve: it charges when open to the positive side and exhausts when open to the negative one.

    `o` is the opening, -1 … 1; the effective areas are `area`·max(o, 0) and `area`·max(-o, 0).
    """

    area: Scalar = parameter("m^2", "effective valve area, fully open", positive=True)
    time_constant: Scalar = parameter("s", "time constant of the spool", positive=True)
    full_command: Scalar = parameter("V", "command that opens the valve fully", positive=True)
    supply_pressure: Scalar = parameter("Pa", "supply pressure, absolute", positive=True)

    def opening_rate(self, command: Value, opening: Value) -> Value:
        r"""First-order spool: :math:`\dot o = (u/u_{full} - o)/τ` [1/s]; command u in volts."""
        return (command / self.full_command - opening) / self.time_constant

    def mass_flow(
        self, opening: Value, pressure: Value, ambient_pressure: Value, temperature: Value
    ) -> Value:
        """Flow into the muscle [kg/s]: charge from the supply minus exhaust to ambient ([H] 2.18).

        Continuous; its slope over the opening is another on either side of a shut valve. At an opening of 0
        the derivative is that of charging: a linear model about a shut valve sees that side only.
        """
        charging = opening >= 0
        # One of the two ports is shut, so that one nozzle is enough.
        source = jnp.where(charging, self.supply_pressure, pressure)
        sink = jnp.where(charging, pressure, ambient_pressure)
        # A negative area turns the flow round.
        return nozzle_flow(self.area * opening, source, sink, temperature)
