"""The causal chain of an actuator as named signals, and the slots where an effect may add to it.

Signs: contraction +, tension +, flow into a chamber +. SI throughout, pressures absolute unless a name
says gauge. A machine with one muscle carries scalars, one with several carries arrays over its muscles.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Muscles = Float[Array, "*muscles"]


@dataclasses.dataclass(frozen=True)
class Slot:
    """A signal to which effects may add; `unit` is its SI unit (templates as in `parameter`)."""

    name: str
    unit: str


COMMAND = Slot("command", "{command}")
TIP_FORCE = Slot("tip_force", "N")
TIP_POSITION = Slot("tip_position", "m")
SUPPLY_PRESSURE = Slot("supply_pressure", "Pa")
MASS_FLOW = Slot("mass_flow", "kg/s")
VOLUME = Slot("volume", "m^3")
PRESSURE_RATE = Slot("pressure_rate", "Pa/s")
MUSCLE_FORCE = Slot("muscle_force", "N")
LOAD = Slot("load", "{load}")
FORCE_READING = Slot("force_reading", "N")
PRESSURE_READING = Slot("pressure_reading", "Pa")
POSITION_READING = Slot("position_reading", "{motion}")

SLOTS = (
    COMMAND,
    TIP_FORCE,
    TIP_POSITION,
    SUPPLY_PRESSURE,
    MASS_FLOW,
    VOLUME,
    PRESSURE_RATE,
    MUSCLE_FORCE,
    LOAD,
    FORCE_READING,
    PRESSURE_READING,
    POSITION_READING,
)


class Past(eqx.Module):
    """The command as it was: zero-order hold, looked up `delay` seconds before the present interval.

    A delay that is no multiple of the sampling step gives the mean of the delayed command over the
    interval, so that the value is continuous in the delay and has a one-sided derivative at zero.
    Before row `first`, where the machine is taken to be at rest, the command was `before`.

    Attributes:
        switched: whether the command that comes late by the machine's dead time has switched within the
            interval, where steps end at that switch (:mod:`jaxmuscle.simulation.command_switch`).
    """

    table: Float[Array, "samples *muscles"]
    row: Array
    step: Float[Array, ""]
    before: Muscles
    first: Array | int = 0
    switched: Array | None = None

    def late(self, delay: Float[Array, ""]) -> Muscles:
        """The command in the step under way that comes late by the machine's dead time `delay` [s].

        By itself, not its mean, where steps end at its switch.
        """
        if self.switched is None:
            return self(delay)
        row = self.row - jnp.floor(delay / self.step).astype(int)
        return jnp.where(self.switched, self._at(row), self._at(row - 1))

    def __call__(self, delay: Float[Array, ""]) -> Muscles:
        """The command that acts now if it comes `delay` [s] late, its mean over the interval."""
        lag = delay / self.step
        whole = jnp.floor(lag)
        part = lag - whole
        row = self.row - whole.astype(int)
        return (1 - part) * self._at(row) + part * self._at(row - 1)

    def _at(self, row: Array) -> Muscles:
        return jnp.where(row >= self.first, self.table[jnp.maximum(row, self.first)], self.before)


class Signals(eqx.Module):
    """What is known at one instant along the chain; a rig fills what it has and leaves the rest `None`."""

    command: Any = None  # unit of the rig's command
    past: Past | None = None
    time: Any = None  # s since the first row of the recording; only where an effect reads it
    moves_valve: Any = 1.0  # of each command: 1, or 0 where it moves no valve
    neutral: Any = None  # the command under which the valve is shut
    valve: Any = None  # the flow valve, for its constants
    opening: Any = None  # of the flow valve, -1 … 1
    supply_pressure: Any = None  # Pa, absolute, before the flow valve
    ambient_pressure: Any = None  # Pa
    gas_temperature: Any = None  # K
    current: Any = None  # A, in the coil of the valve
    tip_force: Any = None  # N, of the torque motor on the tip of a jet pipe
    tip_position: Any = None  # m, where that force holds the tip
    pipe: Any = None  # the jet-pipe component, for its constants
    pressure: Any = None  # Pa, absolute, in the muscle
    valve_flow: Any = None  # kg/s, through the valve
    mass_flow: Any = None  # kg/s into the chamber
    volume: Any = None  # m^3, of the chamber
    volume_rate: Any = None  # m^3/s
    polytropic_exponent: Any = None  # of the chamber
    pressure_rate: Any = None  # Pa/s, in the chamber
    contraction: Any = None  # m, shortening of the muscle
    contraction_velocity: Any = None  # m/s
    muscle: Any = None  # the muscle component, for its geometry
    contraction_ratio: Any = None  # filled in where there is no `muscle`; effects read it as `strain`
    muscle_force: Any = None  # N, tension
    load: Any = None  # N or N m, what accelerates the load
    position: Any = None  # m or rad, of the load
    velocity: Any = None  # m/s or rad/s
    dry_limits: Any = None  # N or N m on the load, of dry friction in threads and in guide or bearing
    limit_over_rest: Any = 1.0  # of each of the two, its limit in motion over that at rest
    force: Any = None  # N, what the force sensor is loaded with
    force_reading: Any = None  # N, what the force sensor shows
    found: Mapping[str, Any] = eqx.field(default_factory=dict)  # effect with a state → its slot before it
    # What the sensors of pressure [Pa, absolute] and of the motion [m or rad] show, where an effect asks.
    pressure_reading: Any = None
    position_reading: Any = None

    @property
    def gauge_pressure(self) -> Muscles:
        """Pressure in the muscle above ambient [Pa]."""
        return self.pressure - self.ambient_pressure

    @property
    def strain(self) -> Muscles:
        """Contraction ratio ε [-]: what the rig has filled in, else that of its muscle."""
        if self.contraction_ratio is not None:
            return self.contraction_ratio
        return self.muscle.strain(self.contraction)

    def having(self, **signals: Any) -> Signals:
        """A copy with further signals filled in."""
        return dataclasses.replace(self, **signals)
