"""Static corrections of the ideal muscle force: ends, unequal muscles."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals

BAR = 1e5


class PressureDependentEnds(AbstractStaticEffect):
    r"""The conic ends shrink with pressure: :math:`k(P) = k + a_k e^{-P/1\,bar}`.

    [T] equation 10, as the difference to the force with constant k. P: gauge pressure [Pa].
    """

    name: ClassVar = "pressure_dependent_ends"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure"})
    strength: ClassVar = "amplitude"
    starts: ClassVar = ({},)
    source: ClassVar = "[T] equation 10"

    amplitude: Scalar = parameter("", "amplitude a_k of the pressure dependence", default=0.0)

    def value(self, signals: Signals) -> Array:
        muscle, gauge = signals.muscle, signals.gauge_pressure
        k = muscle.end_factor + self.amplitude * jnp.exp(-gauge / BAR)
        force = muscle.force(signals.contraction, gauge, k)
        return force - muscle.force(signals.contraction, gauge, muscle.end_factor)


class MuscleMismatch(AbstractStaticEffect):
    r"""The two muscles of an antagonistic pair have different radii, r0 (1 - μ/2) and r0 (1 + μ/2).

    .. math:: ΔF_i = F_i\,[(1 ∓ μ/2)^2 - 1]

    since every term of [T] equation 4 grows with the square of the radius.
    """

    name: ClassVar = "muscle_mismatch"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle_pair"})
    strength: ClassVar = "ratio"
    starts: ClassVar = ({},)
    source: ClassVar = "[T] equation 4 with two radii"

    ratio: Scalar = parameter("", "relative difference μ between the muscles' radii", default=0.0)

    def value(self, signals: Signals) -> Array:
        half = 0.5 * self.ratio * np.array([-1.0, 1.0])
        return signals.muscle_force * ((1 + half) ** 2 - 1)
