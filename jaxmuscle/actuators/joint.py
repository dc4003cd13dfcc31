"""Two muscles pull a sprocket against each other, each fed by a pressure regulator."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from jaxmuscle.actuators.base import Held, State
from jaxmuscle.actuators.channel import Actuation, ControlChannel
from jaxmuscle.actuators.pulled import SIDES, AbstractOpposedMuscles
from jaxmuscle.actuators.regulated import AbstractMuscleJoints, muscle_joints
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.parameters import Scalar, parameter

__all__ = ["SIDES", "Joint"]


class Joint(AbstractOpposedMuscles, AbstractMuscleJoints):
    r"""Rig `joint`: commands → regulated pressures → muscle forces → joint angle.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ ≥ 0, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1. The joint ends at ±ε0 l0/R, where a muscle
    is at its full length, which its braid does not let it pass; the stop is inelastic. Arrays run over the
    two muscles.
    """

    rig: ClassVar = "joint"
    quantities: ClassVar = {**AbstractMuscleJoints.quantities, "inertia": "inertia"}
    variables: ClassVar = muscle_joints(("command_1", "command_2"), ("pressure_1", "pressure_2"), ("angle",))
    available: ClassVar = frozenset(
        "command past pressure muscle muscle_pair contraction contraction_velocity "
        "position velocity angle".split()
    )

    channel: ClassVar = ControlChannel("angle")

    regulator: PressureRegulator
    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia of the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "radius of the sprocket", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def actuation(self, mean_pressure: ArrayLike = 2.5e5) -> Actuation:
        """Commands P0 ± ΔU, between no pressure and twice the mean one ([T]).

        `mean_pressure`: P0, gauge [Pa].
        """
        ambient, mean, side = self.ambient_pressure, jnp.asarray(mean_pressure, dtype=float), jnp.ones(2)
        rest, highest = (ambient + mean) * side, (ambient + 2 * mean) * side
        return Actuation(rest, jnp.asarray(SIDES), ambient * side, highest)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {**self._pressure_rates(state, signals), **self._motion_rates(state, signals)}
