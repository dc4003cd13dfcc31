"""What machines with pressure regulators have in common, and what joints between muscles share besides."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator, Held, Link, State
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.effects.base import States, altered_muscle
from jaxmuscle.parameters import Scalar
from jaxmuscle.signals import COMMAND, MUSCLE_FORCE, Signals


class AbstractRegulated(AbstractActuator):
    """Commands → regulated pressures, one or one a muscle; the pressure and its rate are states."""

    regulator: eqx.AbstractVar[PressureRegulator]

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return measured["pressure"]

    def _pressure_rates(self, state: State, signals: Signals) -> State:
        """Rates of the pressure and of its rate."""
        acceleration = self.regulator.acceleration(signals.command, signals.pressure, state["pressure_rate"])
        return {"pressure": state["pressure_rate"], "pressure_rate": acceleration}


class AbstractMuscleJoints(AbstractRegulated):
    """Equal muscles on sprockets of one radius; pressures and angles are measured."""

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
        "ambient_pressure": "ambient_pressure",
    }
    derivatives: ClassVar = {"angular_velocity": "angle"}
    imposed: ClassVar = ()
    links: ClassVar = (
        Link("pressure", ("angle", "angular_velocity"), "command"),
        Link("angle", ("pressure",), "load"),
    )
    largest_step: ClassVar = 0.002

    muscle: eqx.AbstractVar[McKibben]
    sprocket_radius: eqx.AbstractVar[Scalar]
    initial_contraction: eqx.AbstractVar[Scalar]
    ambient_pressure: eqx.AbstractVar[Scalar]

    def rest(self, measured: Mapping[str, Array]) -> State:
        return {"pressure_rate": jnp.zeros(len(self.commands)), **measured}

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
        signals = self._with(signals, COMMAND, held.command, states)
        force = muscle.force(signals.contraction, signals.gauge_pressure, muscle.end_factor)
        return self._with(signals, MUSCLE_FORCE, force, states)

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}

    def constrained(self, state: State) -> State:
        return state
