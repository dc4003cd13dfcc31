"""A test machine imposes length and pressure on one muscle and measures the pulling force."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array

from jaxmuscle.actuators.actuator import Held, State
from jaxmuscle.actuators.imposed import AbstractImposed
from jaxmuscle.actuators.variables import Reading, StateVariable
from jaxmuscle.components import McKibben
from jaxmuscle.components.cylinder import tension
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.contacts import NO_CONTACT, bristle, with_contacts
from jaxmuscle.effects.slip import friction_limit, slip_of_velocity
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, MUSCLE_FORCE, Signals


class Driven(AbstractImposed):
    """Rig `driven`: pressure and contraction are imposed and measured, the force is predicted ([T] 4, 7).

    A muscle cannot push: where force, effects and friction of the threads together would, the force is 0.
    """

    rig: ClassVar = "driven"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "ambient_pressure": "ambient_pressure",
    }
    variables: ClassVar = (
        StateVariable(
            "pressure", "Pa", ("pressure",), rest="ambient_pressure", imposed=True, check="muscle pressure"
        ),
        StateVariable("contraction", "m", ("position",), rate="velocity", imposed=True, check="contraction"),
        Reading(
            "force", "N", ("force",), ("pressure", "contraction", "velocity"), "muscle_force",
            check="muscle force",
        ),
    )  # fmt: skip
    available: ClassVar = frozenset(
        "time pressure muscle contraction contraction_velocity slip force".split()
    )

    muscle: McKibben
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(
            time=held.time,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=self.muscle,
            contraction=state["contraction"],
            contraction_velocity=state["velocity"],
        )
        force = self.muscle.force(signals.contraction, signals.gauge_pressure, self.muscle.end_factor)
        signals = self._with(signals, MUSCLE_FORCE, force, states)
        signals = with_contacts(self.effects, signals, lambda at: (self._dry_limit(at), NO_CONTACT))
        built_up = bristle(self.effects, states, signals)
        slip = slip_of_velocity(state["velocity"], widening=held.widening, bristle=built_up)
        friction = self._dry_limit(signals) * slip
        signals = signals.having(force=tension(signals.muscle_force - friction))
        return self._with(signals, FORCE_READING, signals.force, states)

    def _dry_limit(self, signals: Signals) -> Array | float:
        return friction_limit(self.effects, MUSCLE_FORCE, signals)

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"force": signals.force_reading}
