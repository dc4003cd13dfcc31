"""Force of the muscle that is lost with time, and over the way that its contraction has gone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import LOOP, TIME, AbstractMemoryEffect, AbstractStaticEffect
from jaxmuscle.hysteresis.operators import bouc_wen
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals

LOST = 0.5
"""Share of the force that a muscle loses or gains within a recording at most: with more it is another muscle
at the end. Only what is lost within it can be told; with a time constant of many recordings a share of 1 may
be right. Creep of a coil muscle on windows of 40 s, and two muscles of different lengths in one recording,
came out as drifts of 1.0 and -1.5."""


class ForceDrift(AbstractStaticEffect):
    r"""The force decays from the first row of the recording on: :math:`ΔF = -d\,F\,(1 - e^{-t/τ})`.

    F: force of the muscle without effects [N], t: time since the first row [s], also across breaks. A
    negative share lets the force grow. With τ far above the recording's length a decay in proportion to t,
    of which only d/τ can be told. A first-order law for softening under use (Mullins, Rubber Chem. Technol.
    42, 1969) and warming up.
    """

    name: ClassVar = "force_drift"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"time", "muscle_force"})
    strength: ClassVar = "share"
    starts: ClassVar = tuple({"time_constant": tau} for tau in (10.0, 60.0, 600.0))
    source: ClassVar = "first-order decay in time; softening, Mullins 1969"
    view: ClassVar = TIME

    share: Scalar = parameter("", "share of the force that is lost in the end", default=0.0)
    time_constant: Scalar = parameter("s", "time constant of the decay", default=60.0, positive=True)

    def value(self, signals: Signals) -> Array:
        return self.share * jnp.expm1(-signals.time / self.time_constant) * signals.muscle_force

    def largest_on(self, duration: float, ranges: Mapping[str, float]) -> float:
        """Half of the force may be lost, or gained, within the recording (:data:`LOST`)."""
        return LOST / -math.expm1(-duration / float(self.time_constant))


class BoucWen(AbstractMemoryEffect):
    r"""Hysteresis of the force in the contraction by the Bouc-Wen model.

    .. math:: ΔF = -F_b z,\quad d\,\frac{dz}{dx} = 1 - \tfrac12 |z|\,(1 + \mathrm{sgn}(z \dot x))

    Bouc (1967), Wen (J. Eng. Mech. Div. 102, 1976) with exponent 1 and β = γ = 1/2, so that |z| ≤ 1 and
    unloading is elastic; exact over straight moves of the contraction x [m], and independent of their pace.
    """

    name: ClassVar = "bouc_wen"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"contraction"})
    strength: ClassVar = "amplitude"
    starts: ClassVar = tuple({"distance": distance} for distance in (3e-3, 1e-3, 1e-2))
    source: ClassVar = "Bouc 1967, Wen 1976"
    view: ClassVar = LOOP

    amplitude: Scalar = parameter("N", "half-width F_b of the saturated loop", default=0.0, nonnegative=True)
    distance: Scalar = parameter("m", "contraction over which z builds up", default=3e-3, positive=True)

    def initial(self, signals: Signals) -> tuple[Array, Array]:
        return jnp.zeros_like(signals.contraction), signals.contraction

    def update(self, memory: tuple[Array, Array], signals: Signals, step: Array) -> tuple[Array, Array]:
        return self._after(memory, signals), signals.contraction

    def value(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        return -self.amplitude * self._after(memory, signals)

    def _after(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        z, before = memory
        return bouc_wen(z, signals.contraction - before, self.distance)
