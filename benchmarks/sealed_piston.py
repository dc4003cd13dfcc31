"""A rig that is not in the package: a piston that is pushed through its cylinder at constant pressure."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array

from jaxmuscle.actuators import AbstractImposed, Held, Reading, StateVariable, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.contacts import NO_CONTACT, bristle, with_contacts
from jaxmuscle.effects.slip import friction_limit, slip_of_velocity
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, LOAD, Signals


@register
class SealedPiston(AbstractImposed):
    """F = A P + c + dry friction along the motion. Pressure and motion are imposed, F is predicted."""

    rig: ClassVar = "sealed-piston"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {"area": "area", "offset": "offset", "ambient_pressure": "ambient_pressure"}
    variables: ClassVar = (
        StateVariable("pressure", "Pa", ("pressure",), rest="ambient_pressure", imposed=True),
        StateVariable("position", "m", ("position",), rate="velocity", imposed=True),
        Reading("force", "N", ("force",), ("pressure", "position", "velocity"), "load"),
    )
    available: ClassVar = frozenset("time pressure position velocity slip force".split())

    area: Scalar = parameter("m^2", "area of the piston", positive=True)
    offset: Scalar = parameter("N", "zero of the load cell", default=0.0, typical=5.0)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(
            time=held.time,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            position=state["position"],
            velocity=state["velocity"],
        )
        force = self.area * signals.gauge_pressure + self.offset
        signals = self._with(signals, LOAD, force, states)
        signals = with_contacts(self.effects, signals, lambda at: (NO_CONTACT, self._dry_limit(at)))
        built_up = bristle(self.effects, states, signals)
        slip = slip_of_velocity(state["velocity"], widening=held.widening, bristle=built_up)
        pushed = signals.load + self._dry_limit(signals) * slip
        return self._with(signals.having(force=pushed), FORCE_READING, pushed, states)

    def _dry_limit(self, signals: Signals) -> Array | float:
        return friction_limit(self.effects, LOAD, signals)

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"force": signals.force_reading}
