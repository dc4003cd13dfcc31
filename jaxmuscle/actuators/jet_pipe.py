"""Jet-pipe actuators: a jet-pipe valve feeds both sides of a piston, which a stopper holds (the rod pulls on
a force sensor) or which is free to slide.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.control_channel import Actuation, ControlChannel
from jaxmuscle.actuators.variables import Command, Reading, StateVariable, Variable
from jaxmuscle.components import ChamberGas, CurrentDriver, Cylinder, JetPipe, Piston, Receiver
from jaxmuscle.components.gas import heat_of
from jaxmuscle.effects.base import AbstractEffect, States
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.effects.contacts import NO_CONTACT, bristle, with_contacts
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import (
    COMMAND,
    FORCE_READING,
    LOAD,
    MASS_FLOW,
    PRESSURE_RATE,
    TIP_FORCE,
    TIP_POSITION,
    VOLUME,
    Signals,
)

BEHIND_A_JET_PIPE: tuple[Variable, ...] = (
    StateVariable("current", "A"),
    StateVariable("pipe", "m"),
    StateVariable("pressure", "Pa"),
    Reading("current", "A", ("current",), signal="command"),
    Reading("force", "N", ("force",), signal="tip_position"),
)
"""States and readings of machines behind a jet-pipe valve."""


class AbstractJetPipe(AbstractActuator):
    """Command → current → tip force → tip position; current and force are measured, no state is."""

    driver: eqx.AbstractVar[CurrentDriver]
    pipe: eqx.AbstractVar[JetPipe]
    ambient_pressure: eqx.AbstractVar[Scalar]
    gas_temperature: eqx.AbstractVar[Scalar]

    def _up_to_the_tip(self, state: State, held: Held, states: States, **known: Any) -> Signals:
        """The chain up to the tip's static position; `known`: further signals that effects may read."""
        signals = Signals(
            past=held.past,
            neutral=0.0,
            ambient_pressure=self.ambient_pressure,
            gas_temperature=self.gas_temperature,
            pipe=self.pipe,
            current=state["current"],
            pressure=state["pressure"],
            **known,
        )
        signals = self._with(signals, COMMAND, held.command, states)
        signals = self._with(signals, TIP_FORCE, self.pipe.tip_force(signals.current), states)
        return self._with(signals, TIP_POSITION, self.pipe.static_position(signals.tip_force), states)

    def linear_part(self, state: State) -> State:
        # The tip follows small currents linearly; how far it saturates is left to the rest.
        unsaturated = self.pipe.compliance * self.pipe.tip_force(state["current"])
        return {
            "current": -self.driver.bandwidth * state["current"],
            "pipe": self.pipe.rate(unsaturated, state["pipe"]),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"current": signals.current, "force": signals.force_reading}

    def constrained(self, state: State) -> State:
        return state


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
        "command past neutral current pipe tip_force tip_position valve_flow mass_flow volume pressure_rate "
        "chambers force".split()
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
        signals = self._up_to_the_tip(state, held, states, polytropic_exponent=self.polytropic_exponent)
        signals = self._charged(signals, state, states)
        pull = jnp.maximum(self.cylinder.force(signals.pressure), self.residual_force)
        return self._with(signals.having(force=pull), FORCE_READING, pull, states)

    def _charged(self, signals: Signals, state: State, states: States) -> Signals:
        """The chain from the tip to the rates of the pressures."""
        through = self._through_the_ports(state)
        leak = self.cylinder.leak(signals.pressure, self.gas_temperature) * jnp.array([-1.0, 1.0])
        signals = self._with(signals.having(valve_flow=through), MASS_FLOW, through + leak, states)
        volumes = self.cylinder.volumes(self.stopper_position)
        signals = self._with(signals.having(volume_rate=jnp.zeros(2)), VOLUME, volumes, states)
        rate = self.cylinder.pressure_rate(
            signals.mass_flow, signals.volume, self.gas_temperature, self.polytropic_exponent
        )
        return self._with(signals, PRESSURE_RATE, rate, states)

    def _through_the_ports(self, state: State) -> Array:
        """Flows through the ports of the receiver into both chambers [kg/s]."""
        tip, pressure, temperature = state["pipe"][1], state["pressure"], self.gas_temperature
        position = self.pipe.over_receiver(tip)
        return self.receiver.mass_flow(position, pressure, self.ambient_pressure, temperature)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            "current": self.driver.current_rate(signals.command, signals.current),
            "pipe": self.pipe.rate(signals.tip_position, state["pipe"]),
            "pressure": signals.pressure_rate,
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }


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
        "command past neutral current pipe tip_force tip_position valve_flow mass_flow pressure chambers "
        "position velocity slip force".split()
    )
    largest_step: ClassVar = 2.5e-4
    channel: ClassVar = ControlChannel("force", "A")

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

    def actuation(self) -> Actuation:
        """Undo gain and offset of the driver, as of rig `jet-pipe`; the supply pressure stays."""
        limit, supply = jnp.full(2, jnp.inf), self.receiver.supply_pressure
        rest = jnp.stack([-self.driver.offset / self.driver.gain, supply])
        return Actuation(rest, jnp.stack([1 / self.driver.gain, jnp.zeros(())]), -limit, limit)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_tip(
            state, held, states, position=state["position"], velocity=state["velocity"],
            moves_valve=jnp.array([1.0, 0.0]),
        )  # fmt: skip
        through, leak, _ = self._flows(state, signals.command[1])
        signals = self._with(signals.having(valve_flow=through), MASS_FLOW, through + leak, states)
        x, v = signals.position, signals.velocity
        rod = self.piston.rod_force(self.stopper_position - self.cylinder.stopper_length - x, v)
        net = self.cylinder.force(signals.pressure) - rod + self.piston.end_force(x, v)
        signals = self._with(signals, LOAD, net - self.piston.viscous_force(v), states)
        signals = with_contacts(self.effects, signals, lambda at: (NO_CONTACT, self._dry_limit(at)))
        limit = self._dry_limit(signals)
        built_up = bristle(self.effects, states, signals)
        mass = self.piston.mass
        slip = slip_of_mass(signals.load, mass * v, limit, held.widening, built_up, mass)
        signals = signals.having(load=signals.load - limit * slip, force=rod)
        return self._with(signals, FORCE_READING, rod, states)

    def _dry_limit(self, signals: Signals) -> Array:
        return self.piston.dry_limit(signals.velocity) + friction_limit(self.effects, LOAD, signals)

    def _flows(self, state: State, supply_pressure: Array) -> tuple[Array, Array, Array]:
        """Flows into the chambers through the ports and past the piston [kg/s], the heat Σ ṁ T they carry."""
        tip, pressure, own = state["pipe"][1], state["pressure"], state["temperature"]
        inflow, outflow = self.receiver.streams(
            self.pipe.over_receiver(tip), pressure, supply_pressure, self.ambient_pressure,
            self.gas_temperature, own,
        )  # fmt: skip
        leak = self.cylinder.leak(pressure, own) * jnp.array([-1.0, 1.0])
        heat = heat_of(inflow, own, self.gas_temperature) + heat_of(-outflow, own, self.gas_temperature)
        return inflow - outflow, leak, heat + heat_of(leak, own, own[::-1])

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        own, velocity = state["temperature"], state["velocity"]
        through, leak, heat = self._flows(state, signals.command[1])
        heat = heat + heat_of(signals.mass_flow - (through + leak), own, self.gas_temperature)
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
