"""A rig that is not in the package: a joint between two muscles whose pressures were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators import Held, StateVariable, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.actuators.joint import AbstractOpposedMuscles, joint_angles
from jaxmuscle.components import McKibben
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import Signals


@register
class ArmJoint(AbstractOpposedMuscles):
    """J θ'' = R (F1 - F2) + effects; x = ε0 l0 ± R θ; muscles cannot push. The pressures are imposed."""

    rig: ClassVar = "arm-joint"
    units: ClassVar = {"load": "N m", "motion": "rad"}
    quantities: ClassVar = {**AbstractOpposedMuscles.quantities, "inertia": "inertia"}
    variables: ClassVar = (
        StateVariable("pressure", "Pa", ("pressure_1", "pressure_2"), rest="ambient_pressure", imposed=True),
        *joint_angles(("angle",)),
    )
    available: ClassVar = frozenset(
        "pressure muscle muscle_pair contraction contraction_velocity position velocity angle".split()
    )

    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia about the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "lever of the muscles", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return dict(measured)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {"pressure": jnp.zeros(2), **self._motion_rates(state, signals)}

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"angle": signals.position}
