"""What machines with pressure regulators have in common, and what regulated joints share besides."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, Link, State
from jaxmuscle.actuators.pulled import AbstractPulledJoints
from jaxmuscle.components import PressureRegulator
from jaxmuscle.signals import Signals


class AbstractRegulated(AbstractActuator):
    """Commands → regulated pressures, one or one a muscle; the pressure and its rate are states."""

    regulator: eqx.AbstractVar[PressureRegulator]

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return measured["pressure"]

    def _pressure_rates(self, state: State, signals: Signals) -> State:
        """Rates of the pressure and of its rate."""
        acceleration = self.regulator.acceleration(signals.command, signals.pressure, state["pressure_rate"])
        return {"pressure": state["pressure_rate"], "pressure_rate": acceleration}


class AbstractMuscleJoints(AbstractRegulated, AbstractPulledJoints):
    """Equal muscles on sprockets of one radius; pressures and angles are measured."""

    units: ClassVar = {"command": "Pa", "load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "regulator_frequency": "regulator.frequency",
        "regulator_damping": "regulator.damping",
        **AbstractPulledJoints.quantities,
    }
    imposed: ClassVar = ()
    links: ClassVar = (
        Link("pressure", ("angle", "angular_velocity"), "command"),
        Link("angle", ("pressure",), "load"),
    )

    def rest(self, measured: Mapping[str, Array]) -> State:
        return self.constrained({"pressure_rate": jnp.zeros(len(self.commands)), **measured})

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}
