"""The rubber bladder takes up part of the pressure and resists being deformed."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals


class BladderStiffness(AbstractStaticEffect):
    r"""The rubber bladder resists contraction and takes up part of the pressure.

    .. math:: ΔF = F(ε, \max(P - P_b, 0)) - F(ε, P) - K_b\,ε = -F(ε, \min(P, P_b)) - K_b\,ε

    The force law, in proportion to P, is [T] equation 4 with `end_factor`; below the threshold P_b the braid
    is not yet taut, and the muscle does not pull. Of a gauge pressure P below zero nothing is taken up.
    """

    name: ClassVar = "bladder_stiffness"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = ({},)
    source: ClassVar = "elastic bladder, as in Chou and Hannaford's dead-zone"

    stiffness: Scalar = parameter("N", "force per unit of contraction ratio", default=0.0)
    threshold_pressure: Scalar = parameter("Pa", "pressure taken up by the bladder", default=0.0, typical=2e4)

    def value(self, signals: Signals) -> Array:
        muscle, gauge = signals.muscle, signals.gauge_pressure
        below = jnp.where(gauge > 0, gauge, 0.0)
        # Chosen by comparison: at zero threshold and zero pressure each slope is the one-sided one.
        taken = jnp.where(gauge > self.threshold_pressure, self.threshold_pressure, below)
        lost = muscle.force(signals.contraction, taken, muscle.end_factor)
        return -lost - self.stiffness * muscle.strain(signals.contraction)


class BladderHoopStiffness(AbstractStaticEffect):
    r"""The bladder's wall is stretched around its circumference as the muscle contracts and swells.

    .. math:: ΔF = -E A\,\cot^2α_0\,z\,\frac{q - 1}{q},\quad z = 1 - kε,\quad
              q = \frac{r}{r_0} = \frac{\sqrt{1 - \cos^2α_0\,z^2}}{\sinα_0}

    From the energy ½ EA l0 (q - 1)² of a thin elastic tube of wall cross-section A and modulus E, with
    the braid kinematics of [T] equation 3: ΔF = -dW/d(contraction) at k = 1; as in [T] equation 7 the conic
    ends then replace ε by kε. The radius grows cot²α0 times as fast
    as the length falls, so the force drops steeply over the first per cent of contraction and levels off.
    """

    name: ClassVar = "bladder_hoop_stiffness"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "contraction"})
    strength: ClassVar = "wall_stiffness"
    starts: ClassVar = ({},)
    source: ClassVar = "elastic tube under the kinematics of [T] equation 3"

    wall_stiffness: Scalar = parameter("N", "modulus times cross-section of the wall E A", default=0.0)

    def value(self, signals: Signals) -> Array:
        muscle = signals.muscle
        z = 1 - muscle.end_factor * muscle.strain(signals.contraction)
        swelling = muscle.swelling(z)
        slope = z / jnp.tan(muscle.braid_angle) ** 2 / swelling
        return -self.wall_stiffness * slope * (swelling - 1)
