"""Static corrections of the ideal muscle force: ends, unequal muscles."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.components import McKibben
from jaxmuscle.effects.base import AbstractMuscleEffect, AbstractStaticEffect
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


class MuscleMismatch(AbstractMuscleEffect):
    r"""The second muscle of an antagonistic pair is thicker or thinner than the first: r0 (1 + μ).

    Its force grows with the square of the radius ([T] equation 4), the friction of its threads in
    proportion (equations 14 and 16).
    """

    name: ClassVar = "muscle_mismatch"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle_pair"})
    strength: ClassVar = "ratio"
    starts: ClassVar = ({},)
    source: ClassVar = "[T] equations 4, 14 and 16 with two radii"

    ratio: Scalar = parameter("", "excess μ of the second muscle's radius over the first's", default=0.0)

    def altered(self, muscle: McKibben) -> McKibben:
        radius = muscle.initial_radius * (1 + self.ratio * np.array([0.0, 1.0]))
        return eqx.tree_at(lambda m: m.initial_radius, muscle, radius)
