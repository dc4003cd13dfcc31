"""Dry friction: in the muscle's braid and in the guide or bearing of the load."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractFrictionEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals


class ThreadFriction(AbstractFrictionEffect):
    r"""Dry friction between the threads of the braid, larger in motion than at rest.

    .. math:: F_{max} = f\,S(ε)\,P,\quad f = f_k + (f_s - f_k)\,e^{-|\dot x|/\dot x_s}

    [T] equations 11 and 15 to 17; f_s, f_k here are f_s/n, f_k/n there. S: contact surface [m²],
    P: gauge pressure [Pa], ẋ: contraction velocity [m/s].
    """

    name: ClassVar = "thread_friction"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure", "contraction_velocity"})
    strength: ClassVar = "static_coefficient"
    starts: ClassVar = ({"static_coefficient": 0.015, "kinetic_coefficient": 0.06},)
    source: ClassVar = "[T] equations 11, 15-17"

    static_coefficient: Scalar = parameter(
        "", "static friction coefficient f_s/n", default=0.0, nonnegative=True
    )
    kinetic_coefficient: Scalar = parameter(
        "", "kinetic friction coefficient f_k/n", default=0.0, nonnegative=True, typical=0.06
    )
    velocity_constant: Scalar = parameter(
        "m/s", "velocity over which static turns into kinetic friction", default=0.15, positive=True
    )

    def limit(self, signals: Signals) -> Array:
        surface = signals.muscle.contact_surface(signals.contraction)
        fading = jnp.exp(-jnp.abs(signals.contraction_velocity) / self.velocity_constant)
        f = self.kinetic_coefficient + (self.static_coefficient - self.kinetic_coefficient) * fading
        return f * surface * jnp.maximum(signals.gauge_pressure, 0.0)


class LoadFriction(AbstractFrictionEffect):
    """Coulomb friction of the load's guide or bearing: a constant force (on a joint a torque) F_c."""

    name: ClassVar = "load_friction"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity"})
    strength: ClassVar = "force"
    starts: ClassVar = ({},)
    source: ClassVar = "Coulomb, [H] 2.35"

    force: Scalar = parameter("{load}", "Coulomb friction of the guide", default=0.0, nonnegative=True)

    def limit(self, signals: Signals) -> Array:
        return self.force + 0.0 * signals.velocity
