"""A flow valve inflates one muscle, which lifts a mass off a base plate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.control_channel import ControlChannel
from jaxmuscle.actuators.variables import Command, Reading, StateVariable
from jaxmuscle.components import FlowValve, McKibben
from jaxmuscle.components.cylinder import stopped, stopped_acceleration, tension
from jaxmuscle.components.gas import GAS_CONSTANT
from jaxmuscle.effects.base import AbstractEffect, States
from jaxmuscle.effects.chain import chamber, state_rates
from jaxmuscle.effects.contacts import bristle, slips, with_contacts
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import (
    COMMAND,
    LOAD,
    MASS_FLOW,
    MUSCLE_FORCE,
    PRESSURE_RATE,
    SUPPLY_PRESSURE,
    VOLUME,
    Signals,
)

STANDARD_GRAVITY = 9.80665
"""[m/s^2]"""
PLATE = 0.0, math.inf
"""Stops of the mass: the base plate, and nothing above [m]."""


class Isotonic(AbstractActuator):
    r"""Rig `isotonic`: command → opening → mass flow → pressure → force → motion of the mass.

    .. math:: \dot p = \frac{n R T \dot m - n p \dot V}{V}, \quad m \ddot x = F - m g, \quad x, F ≥ 0

    n: `polytropic_exponent`, 1 for an isothermal chamber. [T] equation 18, [H] 2.29. The base plate at
    x = 0 is unilateral and inelastic: it holds the mass while F < m g and stops it when it falls back. A
    muscle cannot push: F is what is left of force, effects and friction of the threads where that pulls.
    """

    rig: ClassVar = "isotonic"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        "valve_area": "valve.area",
        "valve_time_constant": "valve.time_constant",
        "full_command": "valve.full_command",
        "supply_pressure": "valve.supply_pressure",
        "ambient_pressure": "ambient_pressure",
        "gas_temperature": "gas_temperature",
        "polytropic_exponent": "polytropic_exponent",
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "mass": "mass",
    }
    variables: ClassVar = (
        Command("command", "V", check="valve command"),
        StateVariable("opening", ""),
        StateVariable("pressure", "Pa", ("pressure",), rest="ambient_pressure", check="muscle pressure"),
        StateVariable("position", "m", ("position",), rate="velocity", check="lift"),
        Reading("pressure", given=("position", "velocity"), signal="mass_flow"),
        Reading("position", given=("pressure",), signal="load"),
    )
    available: ClassVar = frozenset(
        "command past time neutral spool supply_pressure valve_flow mass_flow volume pressure_rate pressure "
        "muscle contraction contraction_velocity position velocity slip".split()
    )
    largest_step: ClassVar = 0.002
    channel: ClassVar = ControlChannel("position", lowest="-valve.full_command", highest="valve.full_command")

    valve: FlowValve
    muscle: McKibben
    mass: Scalar = parameter("kg", "mass that is lifted", positive=True)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    gas_temperature: Scalar = parameter("K", "temperature of the gas", default=293.15, positive=True)
    polytropic_exponent: Scalar = parameter(
        "", "1 isothermal … 1.4 adiabatic chamber", default=1.0, positive=True
    )
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return {"opening": jnp.zeros(()), **measured}

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return jnp.zeros(())

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(
            past=held.past,
            time=held.time,
            neutral=0.0,
            valve=self.valve,
            opening=state["opening"],
            polytropic_exponent=self.polytropic_exponent,
            ambient_pressure=self.ambient_pressure,
            gas_temperature=self.gas_temperature,
            pressure=state["pressure"],
            muscle=self.muscle,
            contraction=state["position"],
            contraction_velocity=state["velocity"],
            position=state["position"],
            velocity=state["velocity"],
        )
        signals = self._with(signals, COMMAND, held.command, states)
        signals = self._charged(signals, states)
        force = self.muscle.force(signals.contraction, signals.gauge_pressure, self.muscle.end_factor)
        signals = self._with(signals, MUSCLE_FORCE, force, states)
        loose = self._load(signals, signals.muscle_force, states)
        signals = with_contacts(self.effects, signals, self._dry_limits)
        in_threads, in_guide = self._dry_limits(signals)
        built_up = bristle(self.effects, states, signals)
        slip = slip_of_mass(
            loose.load, self.mass * signals.velocity, jnp.asarray(in_threads + in_guide), held.widening,
            built_up, self.mass,
        )  # fmt: skip
        of_threads, of_guide = slips(slip, built_up)
        rubbed = self._load(signals, signals.muscle_force - in_threads * of_threads, states)
        return rubbed.having(load=rubbed.load - in_guide * of_guide)

    def _charged(self, signals: Signals, states: States) -> Signals:
        """The chain from the supply to the rate of the pressure."""
        signals = self._with(signals, SUPPLY_PRESSURE, self.valve.supply_pressure, states)
        flow = self.valve.mass_flow(
            signals.opening,
            signals.pressure,
            self.ambient_pressure,
            self.gas_temperature,
            signals.supply_pressure,
        )
        signals = self._with(signals.having(valve_flow=flow), MASS_FLOW, flow, states)
        volume, slope = chamber(self.effects, self.muscle, signals.contraction)
        signals = self._with(signals, VOLUME, volume, states)
        # The plate stops the mass within a step, so the volume must not follow it below.
        velocity = jnp.where(signals.position <= 0, jnp.maximum(signals.velocity, 0.0), signals.velocity)
        signals = signals.having(volume_rate=slope * velocity)
        inflow = GAS_CONSTANT * self.gas_temperature * signals.mass_flow
        expanding = signals.pressure * signals.volume_rate
        rate = self.polytropic_exponent * (inflow - expanding) / signals.volume
        return self._with(signals, PRESSURE_RATE, rate, states)

    def _dry_limits(self, signals: Signals) -> tuple[Array | float, Array | float]:
        """Limits of dry friction in the muscle's threads and in the guide [N]."""
        in_threads = friction_limit(self.effects, MUSCLE_FORCE, signals)
        return in_threads, friction_limit(self.effects, LOAD, signals)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle force, which cannot push, to what accelerates the mass."""
        pulling = signals.having(muscle_force=tension(muscle_force))
        return self._with(pulling, LOAD, pulling.muscle_force - self.mass * STANDARD_GRAVITY, states)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        acceleration = signals.load / self.mass
        return {
            "opening": self.valve.opening_rate(signals.command, state["opening"]),
            "pressure": signals.pressure_rate,
            "position": signals.velocity,
            "velocity": stopped_acceleration(acceleration, signals.position, *PLATE),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "position": signals.position}

    def constrained(self, state: State) -> State:
        position, velocity = stopped(state["position"], state["velocity"], *PLATE)
        return {**state, "position": position, "velocity": velocity}
