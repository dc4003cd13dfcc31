"""A jet-pipe valve feeds both sides of a piston that is free to slide; a rod with a stopper is held."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import Held, State
from jaxmuscle.actuators.jet import BEHIND_A_JET_PIPE, AbstractJetPipe
from jaxmuscle.actuators.jetpipe import JetPipeActuator
from jaxmuscle.actuators.variables import Command, StateVariable
from jaxmuscle.components import ChamberGas, CurrentDriver, Cylinder, JetPipe, Piston, Receiver
from jaxmuscle.components.chamber import heat_of
from jaxmuscle.effects.base import AbstractEffect, friction_limit, slip_of_mass, state_rates
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, LOAD, MASS_FLOW, Signals

ADDED = {
    "wall_conductance": "gas.wall_conductance",
    "polytropic_exponent": "gas.polytropic_exponent",
    "piston_mass": "piston.mass",
    "spring_rate": "piston.spring_rate",
    "spring_length": "piston.spring_length",
    "viscous_friction": "piston.viscous",
    "coulomb_friction": "piston.coulomb_force",
    "stiction": "piston.stiction_force",
    "stiction_velocity": "piston.stiction_velocity",
    "stop_stiffness": "piston.stop_stiffness",
    "stop_damping": "piston.stop_damping",
    "stop_width": "piston.stop_width",
    "dead_length": "dead_length",
}
"""Quantities of its card beside those of rig `jet-pipe`."""
LEFT_OUT = ("residual_force", "polytropic_exponent")
"""Quantities of rig `jet-pipe` in whose place spring and gas stand."""


class JetPipePiston(AbstractJetPipe):
    r"""Rig `jet-pipe-piston`: as rig `jet-pipe`, but the piston moves and the gas warms and cools.

    .. math:: V_1 = A_p (x_p + d),\quad V_2 = A_p (L - x_p + d)

    [H] 2.30 to 2.38, the chambers by an energy balance (:class:`ChamberGas`), the supply pressure a second
    column of the command. The rod is held at `stopper_position`, its pull is measured. d: `dead_length` of
    either chamber, without which the one that is empty would have no volume; its size is a choice, not [H]'s.
    """

    rig: ClassVar = "jet-pipe-piston"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        **{name: path for name, path in JetPipeActuator.quantities.items() if name not in LEFT_OUT},
        **ADDED,
    }
    variables: ClassVar = (
        Command("command", "V"),
        Command("supply_pressure", "Pa"),
        *BEHIND_A_JET_PIPE,
        StateVariable("temperature", "K"),
        StateVariable("position", "m"),
        StateVariable("velocity", "m/s"),
    )
    available: ClassVar = frozenset(
        "command past current pipe tip_force tip_position mass_flow chambers position velocity force".split()
    )
    largest_step: ClassVar = 2.5e-4

    driver: CurrentDriver
    pipe: JetPipe
    receiver: Receiver
    cylinder: Cylinder
    piston: Piston
    gas: ChamberGas
    stopper_position: Scalar = parameter("m", "position of the stopper on the rod", positive=True)
    dead_length: Scalar = parameter(
        "m", "dead volume of a chamber, as length of the cylinder", default=1e-3, positive=True
    )
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    gas_temperature: Scalar = parameter(
        "K", "temperature of supply, atmosphere and walls", default=293.15, positive=True
    )
    initial_pressure: Scalar = parameter(
        "Pa", "pressure of both chambers before the first command", default=3e5, positive=True
    )
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        pair = jnp.ones(2)
        return {
            "current": jnp.zeros(()),
            "pipe": jnp.zeros(3),
            "pressure": self.initial_pressure * pair,
            "temperature": self.gas_temperature * pair,
            "position": jnp.zeros(()),
            "velocity": jnp.zeros(()),
        }

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return jnp.stack([jnp.zeros(()), self.receiver.supply_pressure])

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_tip(
            state, held, states, position=state["position"], velocity=state["velocity"]
        )
        flow = self._flows(state, signals.command[1])[0]
        signals = self._with(signals, MASS_FLOW, flow, states)
        x, v = signals.position, signals.velocity
        rod = self.piston.rod_force(self.stopper_position - self.cylinder.stopper_length - x, v)
        net = self.cylinder.force(signals.pressure) - rod + self.piston.end_force(x, v)
        signals = self._with(signals, LOAD, net - self.piston.viscous_force(v), states)
        limit = self.piston.dry_limit(v) + friction_limit(self.effects, LOAD, signals)
        slip = slip_of_mass(signals.load, self.piston.mass * v, limit, held.widening)
        signals = signals.having(load=signals.load - limit * slip, force=rod)
        return self._with(signals, FORCE_READING, rod, states)

    def _flows(self, state: State, supply_pressure: Array) -> tuple[Array, Array]:
        """Flows into the chambers, leak past the piston included [kg/s], and the heat Σ ṁ T they carry."""
        tip, pressure, own = state["pipe"][1], state["pressure"], state["temperature"]
        inflow, outflow = self.receiver.streams(
            self.pipe.over_receiver(tip), pressure, supply_pressure, self.ambient_pressure,
            self.gas_temperature, own,
        )  # fmt: skip
        leak = self.cylinder.leak(pressure, own) * jnp.array([-1.0, 1.0])
        heat = heat_of(inflow, own, self.gas_temperature) + heat_of(-outflow, own, self.gas_temperature)
        return inflow - outflow + leak, heat + heat_of(leak, own, own[::-1])

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        own, velocity = state["temperature"], state["velocity"]
        flow, heat = self._flows(state, signals.command[1])
        heat = heat + heat_of(signals.mass_flow - flow, own, self.gas_temperature)
        travel = jnp.stack([state["position"], self.cylinder.free_length - state["position"]])
        area = self.cylinder.piston_area
        pressure_rate, temperature_rate = self.gas.rates(
            state["pressure"], own, area * (travel + self.dead_length), area * velocity * jnp.array([1, -1]),
            signals.mass_flow, heat, self.gas_temperature,
        )  # fmt: skip
        return {
            "current": self.driver.current_rate(signals.command[0], signals.current),
            "pipe": self.pipe.rate(signals.tip_position, state["pipe"]),
            "pressure": pressure_rate,
            "temperature": temperature_rate,
            "position": velocity,
            "velocity": signals.load / self.piston.mass,
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }
