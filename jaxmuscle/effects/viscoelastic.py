"""Slow memory of rubber and fibre."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractRateEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals


class Creep(AbstractRateEffect):
    r"""An elastic resistance to contraction that builds up slowly, with two time constants.

    .. math:: ΔF = -K\,\tfrac12 (z_1 + z_2),\quad \dot z_i = (ε - z_i)/τ_i

    At constant pressure and load the muscle creeps, at constant length its force relaxes, by the same
    law: two delayed-elasticity elements of the standard linear solid. ε: contraction ratio.
    """

    name: ClassVar = "creep"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "contraction"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = (
        {"fast_time": 1.0, "slow_time": 6.0},
        {"fast_time": 0.2, "slow_time": 1.0},
        {"fast_time": 5.0, "slow_time": 30.0},
    )
    source: ClassVar = "standard linear solid, two delayed elements"

    stiffness: Scalar = parameter("N", "delayed force per unit of contraction ratio", default=0.0)
    fast_time: Scalar = parameter("s", "shorter time constant", default=1.0, positive=True)
    slow_time: Scalar = parameter("s", "longer time constant", default=6.0, positive=True)

    def initial(self, signals: Signals) -> Array:
        return jnp.stack([signals.muscle.strain(signals.contraction)] * 2, axis=-1)

    def rate(self, state: Array, signals: Signals) -> Array:
        strain = signals.muscle.strain(signals.contraction)
        return (strain[..., None] - state) / jnp.stack([self.fast_time, self.slow_time])

    def value(self, state: Array, signals: Signals) -> Array:
        return -self.stiffness * state.mean(-1)
