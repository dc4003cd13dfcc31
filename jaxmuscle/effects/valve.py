"""Effects of a jet-pipe valve: saturation of its torque motor, hysteresis of its tip."""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.effects.base import COMMANDED, LOOP, AbstractEffect, AbstractMemoryEffect, AbstractStaticEffect
from jaxmuscle.effects.command import SpoolHysteresis
from jaxmuscle.hysteresis import FrameRule
from jaxmuscle.hysteresis.operators import play
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import TIP_FORCE, TIP_POSITION, Signals

FRACTIONS = np.arange(1, 9) / 8
"""Thresholds of the play operators, as fractions of the widest."""
LOOP_SHARE, LOOP_POINTS = 0.16, 201
"""Half-width of the major loop of Frame's rule relative to half its span, points of its table."""


class ValveHysteresis(AbstractMemoryEffect):
    r"""Hysteresis of the tip of a jet pipe in the force on it, by eight play operators.

    .. math:: Δx = -w\,c\,\tfrac18 \sum_i (F - F_{r_i}[F]),\quad r_i = r\,i/8

    A part w of the compliance c follows the tip force only behind plays of half-widths up to r. [H] section
    2.4 measured the loop (half-width 0.08 mm) and failed to predict its minor loops from the major one;
    play operators as in [W] equation 1 do. Outside the minor loops the mid-line is displaced by w c r 9/16.
    """

    name: ClassVar = "valve_hysteresis"
    slot: ClassVar = TIP_POSITION
    reads: ClassVar = frozenset({"pipe", "current"})
    strength: ClassVar = "weight"
    starts: ClassVar = ({"width": 0.1}, {"width": 0.25}, {"width": 0.5})
    source: ClassVar = "[H] section 2.4 with the operators of [W] equation 1"
    forms: ClassVar[tuple[type[AbstractEffect], ...]] = (SpoolHysteresis,)
    view: ClassVar = LOOP

    weight: Scalar = parameter("", "part of the compliance that lies behind the plays", default=0.0)
    width: Scalar = parameter("N", "half-width of the widest play, as tip force", default=0.25, positive=True)

    def initial(self, signals: Signals) -> Array:
        force = signals.pipe.tip_force(signals.current)
        return jnp.repeat(force[..., None], len(FRACTIONS), axis=-1)

    def update(self, memory: Array, signals: Signals, step: Array) -> Array:
        return play(memory, signals.pipe.tip_force(signals.current)[..., None], FRACTIONS * self.width)

    def value(self, memory: Array, signals: Signals) -> Array:
        force = signals.pipe.tip_force(signals.current)
        behind = play(memory, force[..., None], FRACTIONS * self.width).mean(-1)
        return -self.weight * signals.pipe.compliance * (force - behind)


class FrameValveHysteresis(AbstractMemoryEffect):
    r"""Hysteresis of the tip of a jet pipe by Frame's rule for minor loops, the way that [H] tried.

    .. math:: Δx = X\,\frac{y - s}{β},\quad s = F/F_{sat},\quad y = s ± β (1 - s^2)

    y by :class:`FrameRule` from the major loop whose halves are s ± β(1 - s²), β = 0.16: 0.08 mm in the
    ±0.5 mm of [H] section 3.2.1. Starts, as the rule does, from the low saturation.

    It models the same thing as :class:`ValveHysteresis` and so is not in the catalogue: a diagnosis that had
    both would find the one or the other by chance, and [H] 3.2.2 found this one no better than the mid-line.
    A card may declare it, ``[effects.valve_hysteresis_by_frame]``, and Python add it, for rigs `jet-pipe` and
    `jet-pipe-piston`.
    """

    name: ClassVar = "valve_hysteresis_by_frame"
    slot: ClassVar = TIP_POSITION
    reads: ClassVar = frozenset({"pipe", "current"})
    strength: ClassVar = "half_width"
    starts: ClassVar = ({},)
    source: ClassVar = "[H] section 2.4, Frame et al. (1982)"
    view: ClassVar = LOOP

    half_width: Scalar = parameter("m", "half the separation of the major loop, X", default=0.0, typical=1e-5)
    span: Scalar = parameter("N", "tip force at which the major loop closes", default=0.7784, positive=True)

    def initial(self, signals: Signals) -> Any:
        return major_loop().update(major_loop().rest(), self._input(signals))

    def update(self, memory: Any, signals: Signals, step: Array) -> Any:
        return major_loop().update(memory, self._input(signals))

    def value(self, memory: Any, signals: Signals) -> Array:
        s = self._input(signals)
        return self.half_width * (major_loop().output(memory, s) - s) / LOOP_SHARE

    def _input(self, signals: Signals) -> Array:
        return jnp.clip(signals.pipe.tip_force(signals.current) / self.span, -1.0, 1.0)


@cache
def major_loop() -> FrameRule:
    """Frame's rule for a loop from -1 to 1 whose halves are s ± β(1 - s²)."""
    s = np.linspace(-1.0, 1.0, LOOP_POINTS)
    with jax.ensure_compile_time_eval():
        return FrameRule(*map(jnp.asarray, (s, s - LOOP_SHARE * (1 - s**2), s + LOOP_SHARE * (1 - s**2))))


class CurrentSaturation(AbstractStaticEffect):
    r"""The torque motor saturates: beyond a current :math:`i_s` the tip force grows no more.

    .. math:: ΔF = k_m\,i\left(\frac{1}{\max(1, |i|/i_s)} - 1\right)

    The current itself, and its reading, are not limited. The strength is 1/i_s, zero without saturation.
    """

    name: ClassVar = "current_saturation"
    slot: ClassVar = TIP_FORCE
    reads: ClassVar = frozenset({"pipe", "current"})
    strength: ClassVar = "inverse_limit"
    starts: ClassVar = tuple({"inverse_limit": 1 / limit} for limit in (0.35, 0.25, 0.18, 0.13, 0.09))
    source: ClassVar = "magnetic saturation of the torque motor, piecewise linear"
    view: ClassVar = COMMANDED

    inverse_limit: Scalar = parameter(
        "1/A", "one over the current at which the tip force saturates", default=0.0, nonnegative=True
    )

    def value(self, signals: Signals) -> Array:
        excess = jnp.maximum(jnp.abs(signals.current) * self.inverse_limit, 1.0)
        return signals.pipe.tip_force(signals.current) * (1 / excess - 1)
