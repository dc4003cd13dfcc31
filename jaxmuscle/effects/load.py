"""Effects of the load: viscous damping, gravity, an end stop."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.components.cylinder import pressing
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


STOP_WIDTH = 1e-4
"""Depth over which an end stop sets in [m or rad]."""


class EndStop(AbstractStaticEffect):
    r"""An elastic stop of the load at a position x_e, on the side of it that is away from zero.

    .. math:: ΔF = -s\,K\,(δ)_+\,(1 + c\,s\,v)_+,\quad δ = s\,(x - x_e),\quad s = \mathrm{sgn}\,x_e

    Hunt and Crossley (J. Appl. Mech. 42, 1975), as :func:`jaxmuscle.components.cylinder.pressing`: the
    stop never pulls. x in m or rad, v its rate. Steps of 2 ms follow contacts up to about
    K = (500/s)² times the mass or inertia.
    """

    name: ClassVar = "end_stop"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"position", "velocity"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = tuple({"position": x} for x in (0.02, 0.04, 0.07, 0.3, -0.3, 0.7, -0.7))
    source: ClassVar = "Hunt and Crossley 1975"

    stiffness: Scalar = parameter("{load}/{motion}", "stiffness of the stop", default=0.0, nonnegative=True)
    position: Scalar = parameter("{motion}", "position of the stop", default=0.05, typical=0.05)
    damping: Scalar = parameter(
        "s/{motion}", "damping c of the stop", default=0.0, nonnegative=True, typical=1.0
    )

    def value(self, signals: Signals) -> Array:
        side = jnp.where(self.position < 0, -1.0, 1.0)
        depth, speed = side * (signals.position - self.position), side * signals.velocity
        return -side * pressing(depth, speed, self.stiffness, self.damping, STOP_WIDTH)
