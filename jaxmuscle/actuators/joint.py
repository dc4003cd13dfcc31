"""Two muscles pull a sprocket against each other, each fed by a pressure regulator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, Held, Link, State
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.effects.base import (
    AbstractEffect,
    States,
    altered_muscle,
    friction_limit,
    slip_of_mass,
    state_rates,
)
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, LOAD, MUSCLE_FORCE, Signals

SIDES = np.array([1.0, -1.0])
"""The sense in which each muscle turns the joint."""


class Joint(AbstractActuator):
    r"""Rig `joint`: commands → regulated pressures → muscle forces → joint angle.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1. Arrays run over the two muscles.
    """

    rig: ClassVar = "joint"
    units: ClassVar = {"command": "Pa", "load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "regulator_frequency": "regulator.frequency",
        "regulator_damping": "regulator.damping",
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "sprocket_radius": "sprocket_radius",
        "initial_contraction": "initial_contraction",
        "inertia": "inertia",
        "ambient_pressure": "ambient_pressure",
    }
    commands: ClassVar = ("command_1", "command_2")
    measured: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "angle": ("angle",)}
    derivatives: ClassVar = {"angular_velocity": "angle"}
    imposed: ClassVar = ()
    outputs: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "angle": ("angle",)}
    links: ClassVar = (
        Link("pressure", ("angle", "angular_velocity"), "command"),
        Link("angle", ("pressure",), "load"),
    )
    available: ClassVar = frozenset(
        "command past pressure muscle muscle_pair contraction contraction_velocity "
        "position velocity angle".split()
    )
    largest_step: ClassVar = 0.002

    regulator: PressureRegulator
    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia of the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "radius of the sprocket", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return {"pressure_rate": jnp.zeros(2), **measured}

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return measured["pressure"]

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        side = SIDES * self.sprocket_radius
        middle = self.initial_contraction * self.muscle.initial_length
        muscle = altered_muscle(self.effects, self.muscle)
        signals = Signals(
            past=held.past,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=muscle,
            contraction=middle + side * state["angle"],
            contraction_velocity=side * state["angular_velocity"],
            position=state["angle"],
            velocity=state["angular_velocity"],
        )
        signals = self._with(signals, COMMAND, held.command, states)
        force = muscle.force(signals.contraction, signals.gauge_pressure, muscle.end_factor)
        signals = self._with(signals, MUSCLE_FORCE, force, states)
        loose = self._load(signals, signals.muscle_force, states)
        in_threads = friction_limit(self.effects, MUSCLE_FORCE, loose) * jnp.ones(2)
        in_bearing = friction_limit(self.effects, LOAD, loose)
        limit = self.sprocket_radius * in_threads.sum() + in_bearing
        slip = slip_of_mass(loose.load, self.inertia * signals.velocity, limit)
        rubbed = self._load(signals, signals.muscle_force - in_threads * SIDES * slip, states)
        return rubbed.having(load=rubbed.load - in_bearing * slip)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle forces, which cannot push, to the torque on the joint."""
        pulling = signals.having(muscle_force=jnp.maximum(muscle_force, 0.0))
        torque = self.sprocket_radius * (SIDES * pulling.muscle_force).sum()
        return self._with(pulling, LOAD, torque, states)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            "pressure": state["pressure_rate"],
            "pressure_rate": self.regulator.acceleration(
                signals.command, signals.pressure, state["pressure_rate"]
            ),
            "angle": signals.velocity,
            "angular_velocity": signals.load / self.inertia,
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}

    def constrained(self, state: State) -> State:
        return state
