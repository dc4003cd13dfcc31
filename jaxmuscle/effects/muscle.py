"""Effects of the muscle: ends, unequal muscles, stiffness and thickness of the wall, hysteresis of the length
by play operators (Prandtl-Ishlinskii).
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.components import McKibben
from jaxmuscle.effects.base import (
    LOOP,
    AbstractMemoryEffect,
    AbstractMuscleEffect,
    AbstractStaticEffect,
    AbstractWallEffect,
)
from jaxmuscle.hysteresis.operators import play, stop
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

    amplitude: Scalar = parameter(
        "", "amplitude a_k of the pressure dependence", default=0.0, nonnegative=True
    )

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
    largest: ClassVar = 0.5
    starts: ClassVar = ({},)
    source: ClassVar = "[T] equations 4, 14 and 16 with two radii"

    ratio: Scalar = parameter("", "excess μ of the second muscle's radius over the first's", default=0.0)

    def altered(self, muscle: McKibben) -> McKibben:
        radius = muscle.initial_radius * (1 + self.ratio * np.array([0.0, 1.0]))
        return eqx.tree_at(lambda m: m.initial_radius, muscle, radius)


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
    further_strengths: ClassVar = ("threshold_pressure",)
    starts: ClassVar = ({},)
    source: ClassVar = "elastic bladder, as in Chou and Hannaford's dead-zone"

    stiffness: Scalar = parameter("N", "force per unit of contraction ratio", default=0.0, nonnegative=True)
    threshold_pressure: Scalar = parameter(
        "Pa", "pressure taken up by the bladder", default=0.0, nonnegative=True, typical=2e4
    )

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

    wall_stiffness: Scalar = parameter(
        "N", "modulus times cross-section of the wall E A", default=0.0, nonnegative=True
    )

    def value(self, signals: Signals) -> Array:
        muscle = signals.muscle
        z = 1 - muscle.end_factor * muscle.strain(signals.contraction)
        swelling = muscle.swelling(z)
        slope = z / jnp.tan(muscle.braid_angle) ** 2 / swelling
        return -self.wall_stiffness * slope * (swelling - 1)


class WallThickness(AbstractWallEffect):
    r"""The wall of bladder and braid has a thickness t: the pressure acts on the inner radius r - t.

    .. math:: ΔF = π P\,\left[2 r_0 t\,\left(2 q - \frac{1}{q \sin^2α_0}\right) - t^2\right],\quad q = r/r_0

    Chou and Hannaford (IEEE Trans. Robotics and Automation 12, 1996), equation 8, the force -P dV/dl of an
    inner volume π(r - t)² l with constant t, by the radius ratio of [T] equation 3 at the length ratio
    1 - kε. P: gauge pressure [Pa]. A wall of constant volume would change nothing. Where the pressure is
    that of a chamber in the muscle, gas fills the inner volume of the plain cylinder (k = 1). Valid for
    0 ≤ t < r0.
    """

    name: ClassVar = "wall_thickness"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure"})
    strength: ClassVar = "thickness"
    largest: ClassVar = 5e-3
    starts: ClassVar = ({},)
    source: ClassVar = "Chou and Hannaford 1996"

    thickness: Scalar = parameter("m", "thickness of the wall", default=0.0, nonnegative=True, typical=1e-3)

    def value(self, signals: Signals) -> Array:
        return signals.gauge_pressure * self._area(
            signals.muscle, signals.contraction, signals.muscle.end_factor
        )

    def room(self, muscle: McKibben, contraction: Array) -> tuple[Array, Array]:
        ratio, t = 1 - muscle.strain(contraction), self.thickness
        radius = muscle.initial_radius * muscle.swelling(ratio)
        room = jnp.pi * t * (2 * radius - t) * muscle.initial_length * ratio
        return room, -self._area(muscle, contraction, 1.0)

    def _area(self, muscle: McKibben, contraction: Array, end_factor: Array | float) -> Array:
        """Force over pressure that the wall adds: the slope of the inner volume less that of the outer."""
        t, q = self.thickness, muscle.swelling(1 - end_factor * muscle.strain(contraction))
        ring = 2 * muscle.initial_radius * t * (2 * q - 1 / (q * jnp.sin(muscle.braid_angle) ** 2))
        return jnp.pi * (ring - t**2)


THRESHOLDS = np.linspace(0.01, 0.08, 8)
"""Half-widths r_i of the play operators, as contraction ratios [-]."""


class LengthHysteresis(AbstractMemoryEffect):
    r"""Hysteresis of the force in the contraction, by eight play operators.

    .. math:: ΔF = -w\,π r_0^2 P\,h(1 + s h),\quad h = \sum_i p_i (ε - F_{r_i}[ε]),\quad
              p_i \propto e^{-r_i/ρ},\ \sum_i p_i r_i = 1

    Play operators F_r and density as in [W] equations 1, 3 and 5, written by their stop operators
    ε - F_r, which vanish at rest and saturate at ±r: h runs from -1 to 1, and w is the half-width of the
    saturated loop relative to π r0² P. s makes the loop unsymmetric.
    """

    name: ClassVar = "length_hysteresis"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure", "contraction"})
    strength: ClassVar = "weight"
    largest: ClassVar = 3.0
    starts: ClassVar = ({},)
    source: ClassVar = "[W] equations 1, 3, 5"
    view: ClassVar = LOOP

    weight: Scalar = parameter(
        "", "half-width of the loop relative to π r0² P", default=0.0, nonnegative=True
    )
    asymmetry: Scalar = parameter("", "difference between the two branches", default=0.0, typical=0.1)
    density_width: Scalar = parameter(
        "", "contraction ratio over which the density of thresholds decays", default=0.1, positive=True
    )

    def initial(self, signals: Signals) -> Array:
        return jnp.repeat(signals.strain[..., None], len(THRESHOLDS), axis=-1)

    def update(self, memory: Array, signals: Signals, step: Array) -> Array:
        return play(memory, signals.strain[..., None], THRESHOLDS)

    def value(self, memory: Array, signals: Signals) -> Array:
        strain = signals.strain[..., None]
        density = jnp.exp(-THRESHOLDS / self.density_width)
        weights = density / (THRESHOLDS * density).sum()
        # A sum, which XLA merges with what is around it, as it does no product of matrices: the Jacobian of
        # a joint takes 71 ms for 112, of a lifted mass 16 for 26.
        loop = (stop(memory, strain, THRESHOLDS) * weights).sum(-1)
        scale = jnp.pi * signals.muscle.initial_radius**2 * signals.gauge_pressure
        return -self.weight * scale * loop * (1 + self.asymmetry * loop)
