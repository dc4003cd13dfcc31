"""Proportional flow valve, pressure regulator as a second-order lag, and the amplifier of a valve's coil."""

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
        self,
        opening: Value,
        pressure: Value,
        ambient_pressure: Value,
        temperature: Value,
        supply_pressure: Value | None = None,
    ) -> Value:
        """Flow into the muscle [kg/s]: charge from the supply minus exhaust to ambient ([H] 2.18).

        The supply pressure is the valve's own unless another one is given.

        Continuous; its slope over the opening is another on either side of a shut valve. At an opening of 0
        the derivative is that of charging: a linear model about a shut valve sees that side only.
        """
        charging = opening >= 0
        # One of the two ports is shut, so that one nozzle is enough.
        supply = self.supply_pressure if supply_pressure is None else supply_pressure
        source = jnp.where(charging, supply, pressure)
        sink = jnp.where(charging, pressure, ambient_pressure)
        # A negative area turns the flow round.
        return nozzle_flow(self.area * opening, source, sink, temperature)


class PressureRegulator(eqx.Module):
    """Regulator (I/P converter) with natural frequency and damping ratio."""

    frequency: Scalar = parameter("Hz", "natural frequency of the regulator", positive=True)
    damping: Scalar = parameter("", "damping ratio of the regulator", positive=True)

    def acceleration(self, command: Value, pressure: Value, pressure_rate: Value) -> Value:
        r""":math:`\ddot P = ω^2 (c - P) - 2ζω \dot P` [Pa/s^2], with :math:`ω = 2π f`.

        Args: command c, pressure P [Pa, both absolute or both gauge], pressure_rate [Pa/s].
        """
        omega = 2 * jnp.pi * self.frequency
        return omega**2 * (command - pressure) - 2 * self.damping * omega * pressure_rate


class CurrentDriver(eqx.Module):
    """Voltage-to-current amplifier with a first-order lag."""

    gain: Scalar = parameter("A/V", "current of the driver per volt of command", positive=True)
    offset: Scalar = parameter("A", "current of the driver at no command", default=0.0, typical=1e-3)
    bandwidth: Scalar = parameter("rad/s", "bandwidth of the driver", default=7050.0, positive=True)

    def current_rate(self, command: Value, current: Value) -> Value:
        r""":math:`\dot i = ω_{cd}\,(g u + i_{off} - i)` [A/s], [H] equations 2.1 to 2.3.

        Args: command u [V], current i [A]. Rated for ±0.4 A.
        """
        return self.bandwidth * (self.gain * command + self.offset - current)

    def steady_current(self, command: Value) -> Value:
        """Current [A] that a constant command u [V] leads to, [H] 2.3: :math:`i = g u + i_{off}`."""
        return self.gain * jnp.asarray(command) + self.offset
