"""A jet-pipe valve feeds both sides of a piston that a stopper holds; the rod pulls on a force sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import Held, State
from jaxmuscle.actuators.channel import Actuation, ControlChannel
from jaxmuscle.actuators.jet import BEHIND_A_JET_PIPE, AbstractJetPipe
from jaxmuscle.actuators.variables import Command
from jaxmuscle.components import CurrentDriver, Cylinder, JetPipe, Receiver
from jaxmuscle.effects.base import AbstractEffect, state_rates
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, MASS_FLOW, Signals


class JetPipeActuator(AbstractJetPipe):
    r"""Rig `jet-pipe`: command → current → tip force → tip position → mass flows → pressures → force.

    .. math:: \dot i = ω_{cd}(g u - i),\quad x^s = h(k_m i),\quad
              \dot p_j = \frac{n R T}{V_j}\,(\dot m_{s,j} - \dot m_{r,j} ∓ \dot m_{leak}),\quad
              F = \max(A_p (p_1 - p_2),\,F_{res})

    [H] 2.1 to 2.7, 2.24, 2.25 and 2.29, the piston held. `residual_force` F_res is the pull of the spring
    that keeps the rod at its stopper. No state is measured: current and force are predicted from the
    command alone.
    """

    rig: ClassVar = "jet-pipe"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        "current_gain": "driver.gain",
        "current_offset": "driver.offset",
        "driver_bandwidth": "driver.bandwidth",
        "tip_force_constant": "pipe.force_constant",
        "pipe_compliance": "pipe.compliance",
        "pipe_saturation_force": "pipe.saturation_force",
        "receiver_offset": "pipe.receiver_offset",
        "pipe_lag_bandwidth": "pipe.lag_bandwidth",
        "pipe_resonance": "pipe.resonance",
        "pipe_damping": "pipe.damping",
        "discharge_coefficient": "receiver.discharge_coefficient",
        "port_diameter": "receiver.port_diameter",
        "supply_pressure": "receiver.supply_pressure",
        "piston_diameter": "cylinder.diameter",
        "cylinder_length": "cylinder.free_length",
        "stopper_length": "cylinder.stopper_length",
        "leak_area": "cylinder.leak_area",
        "leak_slope": "cylinder.leak_slope",
        "stopper_position": "stopper_position",
        "initial_pressure": "initial_pressure",
        "residual_force": "residual_force",
        "ambient_pressure": "ambient_pressure",
        "gas_temperature": "gas_temperature",
        "polytropic_exponent": "polytropic_exponent",
    }
    variables: ClassVar = (Command("command", "V"), *BEHIND_A_JET_PIPE)
    available: ClassVar = frozenset(
        "command past current pipe tip_force tip_position mass_flow chambers force".split()
    )
    largest_step: ClassVar = 1e-3
    channel: ClassVar = ControlChannel("force", "A")

    driver: CurrentDriver
    pipe: JetPipe
    receiver: Receiver
    cylinder: Cylinder
    stopper_position: Scalar = parameter("m", "position of the stopper on the rod", positive=True)
    residual_force: Scalar = parameter("N", "least force on the rod, of its spring", default=0.0)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    gas_temperature: Scalar = parameter("K", "temperature of the gas", default=293.15, positive=True)
    polytropic_exponent: Scalar = parameter(
        "", "1 isothermal … 1.4 adiabatic chambers", default=1.4, positive=True
    )
    initial_pressure: Scalar = parameter(
        "Pa", "pressure of both chambers before the first command", default=3e5, positive=True
    )
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return {
            "current": jnp.zeros(()),
            "pipe": jnp.zeros(3),
            "pressure": self.initial_pressure * jnp.ones(2),
        }

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return jnp.zeros(())

    def actuation(self) -> Actuation:
        """Undo gain and offset of the driver: a controller's output is the current ([H])."""
        limit = jnp.asarray(jnp.inf)
        return Actuation(-self.driver.offset / self.driver.gain, 1 / self.driver.gain, -limit, limit)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_tip(state, held, states)
        signals = self._with(signals, MASS_FLOW, self._mass_flow(state), states)
        pull = jnp.maximum(self.cylinder.force(signals.pressure), self.residual_force)
        return self._with(signals.having(force=pull), FORCE_READING, pull, states)

    def _mass_flow(self, state: State) -> Array:
        """Flows into both chambers, the leak past the piston included [kg/s]."""
        tip, pressure, temperature = state["pipe"][1], state["pressure"], self.gas_temperature
        position = self.pipe.over_receiver(tip)
        through = self.receiver.mass_flow(position, pressure, self.ambient_pressure, temperature)
        leak = self.cylinder.leak(pressure, temperature)
        return through + leak * jnp.array([-1.0, 1.0])

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        volumes = self.cylinder.volumes(self.stopper_position)
        return {
            "current": self.driver.current_rate(signals.command, signals.current),
            "pipe": self.pipe.rate(signals.tip_position, state["pipe"]),
            "pressure": self.cylinder.pressure_rate(
                signals.mass_flow, volumes, self.gas_temperature, self.polytropic_exponent
            ),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }
