"""What machines with pressure regulators have in common, and what regulated joints share besides."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, State
from jaxmuscle.actuators.pulled import AbstractPulledJoints, joint_angles
from jaxmuscle.actuators.variables import Command, Reading, StateVariable, Variable
from jaxmuscle.components import PressureRegulator
from jaxmuscle.signals import Signals


def regulated_pressures(
    commands: tuple[str, ...], pressures: tuple[str, ...], given: tuple[str, ...] = ()
) -> tuple[Variable, ...]:
    """Variables of regulators: columns of their commands and, in the same order, of their pressures.

    Args:
        given: states that are taken as measured where the pressures are predicted.
    """
    check = "regulated pressure"
    return (
        *(Command(name, "Pa") for name in commands),
        StateVariable("pressure", "Pa", pressures, rest="ambient_pressure", check=check),
        StateVariable("pressure_rate", "Pa/s"),
        Reading("pressure", given=given, signal="command"),
    )


def muscle_joints(
    commands: tuple[str, ...], pressures: tuple[str, ...], angles: tuple[str, ...]
) -> tuple[Variable, ...]:
    """Variables of joints that muscles with regulators turn: their columns."""
    return (
        *regulated_pressures(commands, pressures, given=("angle", "angular_velocity")),
        *joint_angles(angles),
    )


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

    units: ClassVar = {"load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "regulator_frequency": "regulator.frequency",
        "regulator_damping": "regulator.damping",
        **AbstractPulledJoints.quantities,
    }

    def rest(self, measured: Mapping[str, Array]) -> State:
        return self.constrained({"pressure_rate": jnp.zeros(len(self.commands)), **measured})

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}
