"""Effects of the load: viscous damping, gravity."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, Signals


class LoadDamping(AbstractStaticEffect):
    r"""Viscous damping of the load: :math:`ΔF = -d\,v`; v in m/s or rad/s."""

    name: ClassVar = "load_damping"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity"})
    strength: ClassVar = "coefficient"
    starts: ClassVar = ({},)
    source: ClassVar = "[H] 2.33"

    coefficient: Scalar = parameter("{load} s/{motion}", "viscous damping", default=0.0, nonnegative=True)

    def value(self, signals: Signals) -> Array:
        return -self.coefficient * signals.velocity


class Gravity(AbstractStaticEffect):
    r"""Weight of a link that turns out of the horizontal plane: :math:`ΔT = -T_g \sin(θ - θ_g)`.

    θ: joint angle [rad]; θ_g: the angle at which the link hangs straight down.
    """

    name: ClassVar = "gravity"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"angle"})
    strength: ClassVar = "torque"
    starts: ClassVar = ({"hanging_angle": 0.0}, {"hanging_angle": 0.5 * math.pi})
    source: ClassVar = "rigid link in a uniform field"

    torque: Scalar = parameter("N m", "largest gravity torque m g l sin(tilt)", default=0.0)
    hanging_angle: Scalar = parameter(
        "rad", "angle at which the link hangs straight down", default=0.0, typical=0.5
    )

    def value(self, signals: Signals) -> Array:
        return -self.torque * jnp.sin(signals.position - self.hanging_angle)
