"""A rig that is not in the package: a coiled fluidic muscle that lifts a weight at a measured pressure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators import AbstractActuator, Held, Reading, StateVariable, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals


class Coil(eqx.Module):
    """A coiled tube: its tension grows with the pressure and falls with the contraction.

    .. math:: F = a P - k (x - x_0)

    P: gauge pressure [Pa]; x: contraction [m]; F: tension beyond that of the weight alone [N].
    """

    initial_length: Scalar = parameter("m", "length under the weight, without pressure", positive=True)
    gain: Scalar = parameter("m^2", "tension per pressure", positive=True)
    stiffness: Scalar = parameter("N/m", "stiffness of the coil", positive=True)
    offset: Scalar = parameter("m", "reading under the weight, without pressure", default=0.0, typical=1e-3)

    def strain(self, contraction: Array) -> Array:
        """Contraction ratio [-]."""
        return contraction / self.initial_length

    def force(self, contraction: Array, gauge_pressure: Array) -> Array:
        """Tension [N] beyond that of the weight alone; contraction [m], gauge pressure [Pa]."""
        return self.gain * gauge_pressure - self.stiffness * (contraction - self.offset)


@register
class CoilMuscle(AbstractActuator):
    """m x'' = F(x, P) - what the effects on the load take. The pressure is imposed, x is predicted."""

    rig: ClassVar = "coil-muscle"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        "mass": "mass",
        "initial_length": "muscle.initial_length",
        "gain": "muscle.gain",
        "stiffness": "muscle.stiffness",
        "offset": "muscle.offset",
        "ambient_pressure": "ambient_pressure",
    }
    variables: ClassVar = (
        StateVariable("pressure", "Pa", ("pressure",), rest="ambient_pressure", imposed=True),
        StateVariable("position", "m", ("position",), rate="velocity"),
        Reading("position", signal="load"),
    )
    available: ClassVar = frozenset(
        "time pressure contraction contraction_velocity position velocity".split()
    )
    largest_step: ClassVar = 5e-3

    muscle: Coil
    mass: Scalar = parameter("kg", "weight that is lifted", positive=True)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return dict(measured)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        x, v = state["position"], state["velocity"]
        signals = Signals(
            time=held.time,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=self.muscle,
            contraction=x,
            contraction_velocity=v,
            position=x,
            velocity=v,
        )
        tension = self.muscle.force(x, signals.gauge_pressure)
        signals = self._with(signals, MUSCLE_FORCE, tension, states)
        signals = self._with(signals, LOAD, signals.muscle_force, states)
        limit = friction_limit(self.effects, LOAD, signals)
        slip = slip_of_mass(signals.load, self.mass * v, limit, held.widening)
        return signals.having(load=signals.load - limit * slip)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        rates = state_rates(self.effects, state.get("effects", {}), signals)
        return {
            "pressure": jnp.zeros_like(state["pressure"]),
            "position": state["velocity"],
            "velocity": signals.load / self.mass,
            "effects": rates,
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"position": signals.position}

    def constrained(self, state: State) -> State:
        return state
