"""Two links in a plane, each joint turned by two muscles against each other."""

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
    state_rates,
)
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.robot.arm import Arm
from jaxmuscle.robot.friction import coupled_slip
from jaxmuscle.robot.kinematics import jacobian, tip
from jaxmuscle.robot.pane import Pane
from jaxmuscle.signals import COMMAND, LOAD, MUSCLE_FORCE, Signals

PULLS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
"""The sense in which each of the four muscles turns each of the two joints."""


class Scara(AbstractActuator):
    r"""Rig `scara`: commands → regulated pressures → muscle forces → joint torques → motion of the arm.

    .. math:: M(q)\,\ddot q + h(q, \dot q) = R\,S F + J^T F_{pane}, \quad x = ε_0 l_0 + R\,S^T q, \quad F ≥ 0

    [T], robot section; S is :data:`PULLS`. A positive angle shortens the first muscle of its joint. Arrays
    run over the four muscles (two of joint 1, two of joint 2) or over the two joints.
    """

    rig: ClassVar = "scara"
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
        "payload": "arm.payload",
        "ambient_pressure": "ambient_pressure",
    }
    commands: ClassVar = ("command_1", "command_2", "command_3", "command_4")
    measured: ClassVar = {
        "pressure": ("pressure_1", "pressure_2", "pressure_3", "pressure_4"),
        "angle": ("angle_1", "angle_2"),
    }
    derivatives: ClassVar = {"angular_velocity": "angle"}
    imposed: ClassVar = ()
    outputs: ClassVar = measured
    links: ClassVar = (
        Link("pressure", ("angle", "angular_velocity"), "command"),
        Link("angle", ("pressure",), "load"),
    )
    available: ClassVar = frozenset(
        "command past pressure muscle contraction contraction_velocity position velocity".split()
    )
    largest_step: ClassVar = 0.002

    regulator: PressureRegulator
    muscle: McKibben
    arm: Arm
    sprocket_radius: Scalar = parameter("m", "radius of the sprockets", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of all muscles at angle 0")
    pane: Pane = eqx.field(default_factory=Pane)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return {"pressure_rate": jnp.zeros(4), **measured}

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return measured["pressure"]

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        angle, velocity = state["angle"], state["angular_velocity"]
        muscle = altered_muscle(self.effects, self.muscle)
        middle = self.initial_contraction * self.muscle.initial_length
        signals = Signals(
            past=held.past,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=muscle,
            contraction=middle + self.sprocket_radius * angle @ PULLS,
            contraction_velocity=self.sprocket_radius * velocity @ PULLS,
            position=angle,
            velocity=velocity,
        )
        signals = self._with(signals, COMMAND, held.command, states)
        force = muscle.force(signals.contraction, signals.gauge_pressure, muscle.end_factor)
        signals = self._with(signals, MUSCLE_FORCE, force, states)
        loose = self._load(signals, signals.muscle_force, states)
        in_threads = friction_limit(self.effects, MUSCLE_FORCE, loose) * jnp.ones(4)
        in_bearing = friction_limit(self.effects, LOAD, loose) * jnp.ones(2)
        limit = self.sprocket_radius * np.abs(PULLS) @ in_threads + in_bearing
        driving = loose.load - self.arm.bias(angle, velocity)
        slip = coupled_slip(driving, velocity, limit, self.arm.mass_matrix(angle))
        rubbed = self._load(signals, signals.muscle_force - in_threads * (slip @ PULLS), states)
        return rubbed.having(load=rubbed.load - in_bearing * slip)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle forces, which cannot push, to the torques at the joints."""
        pulling = signals.having(muscle_force=jnp.maximum(muscle_force, 0.0))
        torque = self.sprocket_radius * PULLS @ pulling.muscle_force
        torque = torque + self.contact_torque(signals.position, signals.velocity)
        return self._with(pulling, LOAD, torque, states)

    def contact_torque(self, angle: Array, velocity: Array) -> Array:
        """Torques at the joints by which the pane pushes the tip back, J' F [N m]."""
        turning = jacobian(self.arm, angle)
        return self.pane.force(tip(self.arm, angle), turning @ velocity) @ turning

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            "pressure": state["pressure_rate"],
            "pressure_rate": self.regulator.acceleration(
                signals.command, signals.pressure, state["pressure_rate"]
            ),
            "angle": signals.velocity,
            "angular_velocity": self.arm.acceleration(signals.position, signals.velocity, signals.load),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}

    def constrained(self, state: State) -> State:
        return state
