"""Effects of the gas between supply and chamber: leak, lag of the line, droop of the supply, dead volume,
heating of the gas.
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.components.gas import GAMMA, GAS_CONSTANT, nozzle_flow
from jaxmuscle.effects.base import AbstractRateEffect, AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MASS_FLOW, PRESSURE_RATE, SUPPLY_PRESSURE, VOLUME, Signals

SHORTEST_LAG = 1e-3
"""Lag below which that of a line is a share of one of this length [s]: less than is sampled."""


class ChamberLeak(AbstractStaticEffect):
    """A leak from the chamber to the atmosphere: nozzle flow through `area` ([H] 2.18)."""

    name: ClassVar = "chamber_leak"
    slot: ClassVar = MASS_FLOW
    reads: ClassVar = frozenset({"mass_flow"})
    strength: ClassVar = "area"
    starts: ClassVar = ({},)
    source: ClassVar = "[H] equations 2.18-2.23"

    area: Scalar = parameter("m^2", "effective area of the leak", default=0.0, nonnegative=True)

    def value(self, signals: Signals) -> Array:
        return -nozzle_flow(self.area, signals.pressure, signals.ambient_pressure, signals.gas_temperature)


class LineLag(AbstractRateEffect):
    r"""The flow that reaches the chamber lags behind that through the valve: :math:`τ \dot y = q - y`.

    The addition is y - q; q: flow through the valve, not that of a leak [kg/s]. The line is lumped into one
    first-order lag; it stores τ (q - y). A lag below 1 ms is a share of one of 1 ms, with the same mean: it
    is nothing at τ = 0, and has a derivative there.
    """

    name: ClassVar = "line_lag"
    slot: ClassVar = MASS_FLOW
    reads: ClassVar = frozenset({"valve_flow"})
    strength: ClassVar = "time_constant"
    largest: ClassVar = 1.0
    starts: ClassVar = ({},)
    source: ClassVar = "line between valve and chamber (Richer and Hurmuzlu, 2000), lumped to first order"

    time_constant: Scalar = parameter(
        "s", "time constant of the line between valve and chamber", default=0.0, nonnegative=True
    )

    def initial(self, signals: Signals) -> Array:
        return jnp.asarray(signals.valve_flow)

    def rate(self, state: Array, signals: Signals) -> Array:
        long = self.time_constant > SHORTEST_LAG
        return (signals.valve_flow - state) / jnp.where(long, self.time_constant, SHORTEST_LAG)

    def value(self, state: Array, signals: Signals) -> Array:
        share = jnp.where(self.time_constant > SHORTEST_LAG, 1.0, self.time_constant / SHORTEST_LAG)
        return share * (state - signals.valve_flow)


class SupplyDroop(AbstractStaticEffect):
    r"""The supply pressure falls with the flow that is drawn: :math:`Δp_s = -R\,\dot m`, :math:`\dot m ≥ 0`.

    The flow depends on the pressure that is left. One step of Newton's method from the declared pressure,
    :math:`Δp_s = -R \dot m/(1 + R\,∂\dot m/∂p_s)`, is exact for choked flow and elsewhere a few per cent of
    the droop too large. No air flows back into the line.
    """

    name: ClassVar = "supply_droop"
    slot: ClassVar = SUPPLY_PRESSURE
    reads: ClassVar = frozenset({"supply_pressure"})
    strength: ClassVar = "resistance"
    starts: ClassVar = ({},)
    source: ClassVar = "linear resistance of the supply line, Beater, Pneumatic Drives (2007)"

    resistance: Scalar = parameter(
        "Pa s/kg",
        "fall of the supply pressure per mass flow",
        default=0.0,
        nonnegative=True,
        typical=1e7,
    )

    def value(self, signals: Signals) -> Array:
        def drawn(supply: Array) -> Array:
            flow = signals.valve.mass_flow(
                signals.opening, signals.pressure, signals.ambient_pressure, signals.gas_temperature, supply
            )
            return jnp.where(flow > 0, flow, 0.0)

        declared = signals.supply_pressure
        flow, slope = jax.jvp(drawn, (declared,), (jnp.ones_like(declared),))
        return -self.resistance * flow / (1 + self.resistance * slope)


class DeadVolume(AbstractStaticEffect):
    """Fittings and line add a constant volume to that of the chamber; to each, where there are two."""

    name: ClassVar = "dead_volume"
    slot: ClassVar = VOLUME
    reads: ClassVar = frozenset({"volume"})
    strength: ClassVar = "volume"
    starts: ClassVar = ({},)
    source: ClassVar = "inactive volume, Richer and Hurmuzlu (2000)"

    volume: Scalar = parameter(
        "m^3",
        "volume of fittings and line beside the chamber's",
        default=0.0,
        nonnegative=True,
        typical=1e-5,
    )

    def value(self, signals: Signals) -> Array:
        return self.volume + jnp.zeros_like(signals.volume)


class GasHeating(AbstractRateEffect):
    r"""The gas warms as it is compressed and takes its wall's temperature again over a thermal time.

    .. math:: \dot z = θ\left[(γ θ_{in} - θ)\,φ - (γ - 1)\frac{\dot V}{V}\right] - \frac zτ,\quad
        \frac{Δ\dot p}{p} = θ φ - φ_0 + s \frac{\dot z}{θ} - s (n - 1)\left(φ_0 - \frac{\dot V}{V}\right)

    θ = 1 + s z is the temperature of the gas over that of its wall and of the gas that comes in
    (:math:`θ_{in} = 1`; of outgoing gas :math:`θ_{in} = θ`), :math:`φ_0 = R T \dot m/(p V)` the relative rate
    of inflow at the wall's temperature; outgoing gas flows as :math:`φ = φ_0/\sqrt θ`. Together with the
    declared polytropic law n the share s of the chamber's energy balance counts: with s = 1 changes faster
    than τ are adiabatic (γ = 1.4), slower ones isothermal.
    """

    name: ClassVar = "gas_heating"
    slot: ClassVar = PRESSURE_RATE
    reads: ClassVar = frozenset({"pressure_rate", "volume"})
    strength: ClassVar = "share"
    starts: ClassVar = ({"thermal_time": 0.1}, {"thermal_time": 0.5}, {"thermal_time": 2.0})
    source: ClassVar = "chamber with heat transfer, Carneiro and de Almeida (2006)"

    share: Scalar = parameter(
        "", "share s of the energy balance in the chamber's law", default=0.0, nonnegative=True
    )
    thermal_time: Scalar = parameter(
        "s", "time in which the gas takes the temperature of its wall", default=0.5, positive=True
    )

    def initial(self, signals: Signals) -> Array:
        return jnp.zeros_like(signals.pressure)

    def rate(self, state: Array, signals: Signals) -> Array:
        warmth, flow = self._gas(state, signals)
        # Per unit of the share, so that nothing is added without one whatever the state.
        coming = jnp.where(signals.mass_flow < 0, warmth, 1.0)
        growth = signals.volume_rate / signals.volume
        heat = (GAMMA * coming - warmth) * flow - (GAMMA - 1) * growth
        return warmth * heat - state / self.thermal_time

    def value(self, state: Array, signals: Signals) -> Array:
        (warmth, flow), cold = self._gas(state, signals), _inflow(signals)
        declared = (signals.polytropic_exponent - 1) * (cold - signals.volume_rate / signals.volume)
        change = warmth * flow - cold + self.share * (self.rate(state, signals) / warmth - declared)
        return signals.pressure * change

    def _gas(self, state: Array, signals: Signals) -> tuple[Array, Array]:
        """Temperature of the gas over its wall's, and relative rate of inflow."""
        warmth, flow = jnp.maximum(1 + self.share * state, COLDEST), _inflow(signals)
        return warmth, jnp.where(signals.mass_flow < 0, flow / jnp.sqrt(warmth), flow)


COLDEST = 0.1
"""Temperature of the gas over its wall's below which no chamber comes: trial steps of a fit may."""


def _inflow(signals: Signals) -> Array:
    """Relative rate of inflow at the wall's temperature, R T m / (p V) [1/s]."""
    inflow = GAS_CONSTANT * signals.gas_temperature * signals.mass_flow
    return inflow / (signals.pressure * signals.volume)
