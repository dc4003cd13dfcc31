"""A rig that is not in the package: a joint between two muscles whose pressures were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.actuators import AbstractActuator, Held, Link, register
from jaxmuscle.actuators.base import State
from jaxmuscle.components import McKibben
from jaxmuscle.effects.base import (
    AbstractEffect,
    States,
    altered_muscle,
    friction_limit,
    slip_of_mass,
    state_rates,
)
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals

SIDES = np.array([1.0, -1.0])


@register
class ArmJoint(AbstractActuator):
    """J θ'' = R (F1 - F2) + effects; x = ε0 l0 ± R θ; muscles cannot push. The pressures are imposed."""

    rig: ClassVar = "arm-joint"
    units: ClassVar = {"load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "initial_contraction": "initial_contraction",
        "sprocket_radius": "sprocket_radius",
        "inertia": "inertia",
    }
    commands: ClassVar = ()
    measured: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "angle": ("angle",)}
    derivatives: ClassVar = {"angular_velocity": "angle"}
    imposed: ClassVar = ("pressure",)
    outputs: ClassVar = {"angle": ("angle",)}
    links: ClassVar = (Link("angle", ("pressure",), "load"),)
    available: ClassVar = frozenset(
        "pressure muscle muscle_pair contraction contraction_velocity position velocity angle".split()
    )
    largest_step: ClassVar = 0.002

    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia about the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "lever of the muscles", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return dict(measured)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        muscle, side = altered_muscle(self.effects, self.muscle), SIDES * self.sprocket_radius
        signals = Signals(
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=muscle,
            contraction=self.initial_contraction * muscle.initial_length + side * state["angle"],
            contraction_velocity=side * state["angular_velocity"],
            position=state["angle"],
            velocity=state["angular_velocity"],
        )
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
        pulling = signals.having(muscle_force=jnp.maximum(muscle_force, 0.0))
        torque = self.sprocket_radius * (SIDES * pulling.muscle_force).sum()
        return self._with(pulling, LOAD, torque, states)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            "pressure": jnp.zeros(2),
            "angle": signals.velocity,
            "angular_velocity": signals.load / self.inertia,
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"angle": signals.position}

    def constrained(self, state: State) -> State:
        return state
