"""Two muscles pull a sprocket against each other, each fed by a pressure regulator."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.actuators.base import Held, State
from jaxmuscle.actuators.regulated import AbstractMuscleJoints
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.effects.base import (
    AbstractEffect,
    States,
    friction_limit,
    slip_of_mass,
    state_rates,
)
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals

SIDES = np.array([1.0, -1.0])
"""The sense in which each muscle turns the joint."""


class Joint(AbstractMuscleJoints):
    r"""Rig `joint`: commands → regulated pressures → muscle forces → joint angle.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1. Arrays run over the two muscles.
    """

    rig: ClassVar = "joint"
    quantities: ClassVar = {**AbstractMuscleJoints.quantities, "inertia": "inertia"}
    commands: ClassVar = ("command_1", "command_2")
    measured: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "angle": ("angle",)}
    outputs: ClassVar = {"pressure": ("pressure_1", "pressure_2"), "angle": ("angle",)}
    available: ClassVar = frozenset(
        "command past pressure muscle muscle_pair contraction contraction_velocity "
        "position velocity angle".split()
    )

    regulator: PressureRegulator
    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia of the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "radius of the sprocket", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_muscles(state, held, states, SIDES)
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
            **self._pressure_rates(state, signals),
            "angle": signals.velocity,
            "angular_velocity": signals.load / self.inertia,
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }
