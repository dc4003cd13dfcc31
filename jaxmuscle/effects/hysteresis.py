"""Rate-independent hysteresis by play operators (Prandtl-Ishlinskii)."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractMemoryEffect
from jaxmuscle.hysteresis.operators import play
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals

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
    starts: ClassVar = ({},)
    source: ClassVar = "[W] equations 1, 3, 5"

    weight: Scalar = parameter("", "half-width of the loop relative to π r0² P", default=0.0)
    asymmetry: Scalar = parameter("", "difference between the two branches", default=0.0, typical=0.1)
    density_width: Scalar = parameter(
        "", "contraction ratio over which the density of thresholds decays", default=0.1, positive=True
    )

    def initial(self, signals: Signals) -> Array:
        strain = signals.muscle.strain(signals.contraction)
        return jnp.repeat(strain[..., None], len(THRESHOLDS), axis=-1)

    def update(self, memory: Array, signals: Signals, step: Array) -> Array:
        return play(memory, signals.muscle.strain(signals.contraction)[..., None], THRESHOLDS)

    def value(self, memory: Array, signals: Signals) -> Array:
        strain = signals.muscle.strain(signals.contraction)[..., None]
        stops = strain - play(memory, strain, THRESHOLDS)
        density = jnp.exp(-THRESHOLDS / self.density_width)
        loop = (stops * density).sum(-1) / (THRESHOLDS * density).sum()
        scale = jnp.pi * signals.muscle.initial_radius**2 * signals.gauge_pressure
        return -self.weight * scale * loop * (1 + self.asymmetry * loop)
