"""Joints that muscles pull on, whatever sets the pressures in them."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.actuators.variables import Reading, StateVariable, Variable
from jaxmuscle.components import McKibben
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.components.contact import stopped, stopped_acceleration, tension
from jaxmuscle.effects.base import States, altered_muscle, friction_limit, slip_of_mass, state_rates
from jaxmuscle.parameters import Scalar
from jaxmuscle.signals import COMMAND, LOAD, MUSCLE_FORCE, Signals

SIDES = np.array([1.0, -1.0])
"""The sense in which each of two muscles turns their joint."""


def joint_angles(angles: tuple[str, ...]) -> tuple[Variable, ...]:
    """Variables of joints that muscles turn: the columns of their angles, predicted from the pressures."""
    return (
        StateVariable("angle", "rad", angles, rate="angular_velocity", check="joint angle"),
        Reading("angle", given=("pressure",), signal="load"),
    )


class AbstractPulledJoints(AbstractActuator):
    """Equal muscles on sprockets of one radius; angles are measured.

    The braid does not stretch: a joint ends, inelastically, where one of its muscles is at its full length,
    x = 0 or θ = ±ε0 l0/R (:func:`jaxmuscle.components.antagonist.joint_range`).
    """

    quantities: ClassVar = {
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "sprocket_radius": "sprocket_radius",
        "initial_contraction": "initial_contraction",
        "ambient_pressure": "ambient_pressure",
    }
    largest_step: ClassVar = 0.002

    muscle: eqx.AbstractVar[McKibben]
    sprocket_radius: eqx.AbstractVar[Scalar]
    initial_contraction: eqx.AbstractVar[Scalar]
    ambient_pressure: eqx.AbstractVar[Scalar]

    def _up_to_the_muscles(
        self, state: State, held: Held, states: States, pulls: NDArray | Float[Array, "..."]
    ) -> Signals:
        """The chain up to the muscle forces.

        `pulls`: the sense in which each muscle turns each joint; for a single joint, its two muscles.
        """
        angle, velocity = state["angle"], state["angular_velocity"]
        middle = self.initial_contraction * self.muscle.initial_length
        muscle = altered_muscle(self.effects, self.muscle)
        signals = Signals(
            past=held.past,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=muscle,
            contraction=middle + jnp.dot(self.sprocket_radius * angle, pulls),
            contraction_velocity=jnp.dot(self.sprocket_radius * velocity, pulls),
            position=angle,
            velocity=velocity,
        )
        if self.commands:
            signals = self._with(signals, COMMAND, held.command, states)
        force = muscle.force(signals.contraction, signals.gauge_pressure, muscle.end_factor)
        return self._with(signals, MUSCLE_FORCE, force, states)

    @property
    def _ends(self) -> tuple[Array, Array]:
        """Angles at which a joint ends [rad]."""
        largest = joint_range(self.muscle, self.sprocket_radius, self.initial_contraction)
        return -largest, largest

    def constrained(self, state: State) -> State:
        angle, velocity = stopped(state["angle"], state["angular_velocity"], *self._ends)
        return {**state, "angle": angle, "angular_velocity": velocity}


class AbstractOpposedMuscles(AbstractPulledJoints):
    r"""One joint between two muscles that pull against each other, with dry friction of threads and bearing.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ ≥ 0, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1.
    """

    inertia: eqx.AbstractVar[Scalar]

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_muscles(state, held, states, SIDES)
        loose = self._load(signals, signals.muscle_force, states)
        in_threads = friction_limit(self.effects, MUSCLE_FORCE, loose) * jnp.ones(2)
        in_bearing = friction_limit(self.effects, LOAD, loose)
        limit = self.sprocket_radius * in_threads.sum() + in_bearing
        slip = slip_of_mass(loose.load, self.inertia * signals.velocity, limit, held.widening)
        rubbed = self._load(signals, signals.muscle_force - in_threads * SIDES * slip, states)
        return rubbed.having(load=rubbed.load - in_bearing * slip)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle forces, which cannot push, to the torque on the joint."""
        pulling = signals.having(muscle_force=tension(muscle_force))
        torque = self.sprocket_radius * (SIDES * pulling.muscle_force).sum()
        return self._with(pulling, LOAD, torque, states)

    def _motion_rates(self, state: State, signals: Signals) -> State:
        """Rates of the angle, of its rate and of the effects' states."""
        acceleration = signals.load / self.inertia
        return {
            "angle": signals.velocity,
            "angular_velocity": stopped_acceleration(acceleration, signals.position, *self._ends),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }
