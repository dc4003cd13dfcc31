"""Creep of the muscle: an elastic resistance to contraction that builds up, or one that relaxes."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import LOG_TIME, AbstractRateEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals


class AbstractDelayedStrain(AbstractRateEffect):
    r"""Common to both: strains z that follow the contraction ratio ε late, at rest equal to it.

    .. math:: \dot z_i = (ε - z_i)/τ_i,\quad i = 1, 2

    τ: `fast_time` and `slow_time` [s].
    """

    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"contraction_ratio"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = (
        {"fast_time": 1.0, "slow_time": 6.0},
        {"fast_time": 0.2, "slow_time": 1.0},
        {"fast_time": 5.0, "slow_time": 30.0},
    )
    view: ClassVar = LOG_TIME

    stiffness: Scalar
    fast_time: Scalar = parameter("s", "shorter time constant", default=1.0, positive=True)
    slow_time: Scalar = parameter("s", "longer time constant", default=6.0, positive=True)

    def initial(self, signals: Signals) -> Array:
        return jnp.stack([signals.strain] * 2, axis=-1)

    def rate(self, state: Array, signals: Signals) -> Array:
        return (signals.strain[..., None] - state) / jnp.stack([self.fast_time, self.slow_time])


class Creep(AbstractDelayedStrain):
    r"""An elastic resistance to contraction that builds up slowly, with two time constants.

    .. math:: ΔF = -K\,\tfrac12 (z_1 + z_2),\quad \dot z_i = (ε - z_i)/τ_i

    At constant pressure and load the muscle gives back a part of its contraction, at constant length its
    force relaxes, by the same law: two delayed-elasticity elements of the standard linear solid. ε:
    contraction ratio. A muscle that goes on contracting has a :class:`ViscoelasticCreep`.
    """

    name: ClassVar = "creep"
    source: ClassVar = "standard linear solid, two delayed elements"

    stiffness: Scalar = parameter(
        "N", "delayed force per unit of contraction ratio", default=0.0, nonnegative=True
    )

    def value(self, state: Array, signals: Signals) -> Array:
        return -self.stiffness * state.mean(-1)


class ViscoelasticCreep(AbstractDelayedStrain):
    r"""An elastic resistance to contraction that relaxes: the muscle goes on contracting.

    .. math:: ΔF = -K\,[ε - \tfrac12 (z_1 + z_2)],\quad \dot z_i = (ε - z_i)/τ_i

    The generalised Maxwell model with two elements of the same stiffness (Ferry, Viscoelastic Properties of
    Polymers, 1980, chapter 1): a stiffness K against fast motion that fades in τ1 and τ2, beside what the
    muscle's own law says of slow motion. At constant pressure and load the contraction creeps on towards the
    end that this law says, and after deflation back from it; at constant length the force rises after a
    contraction. It takes energy in any cycle, K ≥ 0. ε: contraction ratio. Valid for linear viscoelasticity.
    """

    name: ClassVar = "viscoelastic_creep"
    source: ClassVar = "generalised Maxwell model, two elements"

    stiffness: Scalar = parameter(
        "N", "force per unit of contraction ratio that relaxes", default=0.0, nonnegative=True
    )

    def value(self, state: Array, signals: Signals) -> Array:
        return -self.stiffness * (signals.strain - state.mean(-1))
