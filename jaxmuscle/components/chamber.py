"""The gas in a chamber: its pressure and temperature under flows, motion of the wall and heat."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.gas import GAMMA, GAS_CONSTANT
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class ChamberGas(eqx.Module):
    r"""Energy balance of an ideal gas whose ratio of specific heats is n, c_v = R/(n - 1).

    .. math:: \dot p = \frac{n}{V}(R H - p \dot V) + \frac{n - 1}{V} Q,\quad
              \dot T = T\left(\frac{\dot p}{p} + \frac{\dot V}{V} - \frac{R T \dot m}{p V}\right),\quad
              Q = G\,(T_w - T)

    H = Σ ṁ T of the streams, each with the temperature of where it comes from. `polytropic_exponent` n = 1.4
    without `wall_conductance` G is the adiabatic chamber of [H] 2.26 to 2.29 with the temperatures that [H]
    takes as constant; a large G, or n = 1, is the isothermal one.
    """

    polytropic_exponent: Scalar = parameter(
        "", "1 isothermal … 1.4 energy balance of air", default=GAMMA, positive=True
    )
    wall_conductance: Scalar = parameter(
        "W/K", "heat from the wall of a chamber per kelvin", default=0.0, nonnegative=True, typical=0.1
    )

    def rates(
        self,
        pressure: Value,
        temperature: Value,
        volume: Value,
        volume_rate: Value,
        mass_flow: Value,
        heat_flow: Value,
        wall_temperature: Value,
    ) -> tuple[Value, Value]:
        """Rates of pressure [Pa/s] and temperature [K/s], [H] 2.26-2.29 with the first law.

        Args: pressure [Pa, absolute], temperature [K], volume [m^3] and its rate [m^3/s], mass_flow into the
        chamber [kg/s], heat_flow: Σ ṁ T of its streams [kg K/s], wall_temperature [K].
        """
        n = self.polytropic_exponent
        warming = (n - 1) * self.wall_conductance * (wall_temperature - temperature)
        work = pressure * volume_rate
        pressure_rate = (n * (GAS_CONSTANT * heat_flow - work) + warming) / volume
        stored = volume * pressure_rate + work - GAS_CONSTANT * temperature * mass_flow
        return pressure_rate, temperature * stored / (pressure * volume)


def heat_of(flow: Value, inside: Value, outside: Value) -> Value:
    """Σ ṁ T of a stream into a chamber (negative: out of it) [kg K/s]; temperatures [K]."""
    return flow * jnp.where(flow >= 0, outside, inside)
