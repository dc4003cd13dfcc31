"""The classical Prandtl-Ishlinskii model: a weighted sum of play operators."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.hysteresis.base import AbstractHysteresis
from jaxmuscle.hysteresis.operators import play
from jaxmuscle.parameters import Scalar, parameter

Weights = Float[Array, " operators"]


def exponential_density(thresholds: Weights, density: Scalar, decay: Scalar) -> Weights:
    r"""Weights of play operators: :math:`p(r) = ρ e^{-τ r}`, [W] (3)."""
    return density * jnp.exp(-decay * thresholds)


def spaced_thresholds(spacing: Scalar, operators: int, first: int = 1) -> Weights:
    r"""Thresholds :math:`r_i = α i`, [W] (5), i from `first` on."""
    return spacing * jnp.arange(first, first + operators)


class PrandtlIshlinskii(AbstractHysteresis):
    r"""Classical model: :math:`z = c + p_0 v + \sum_i p_i F_{r_i}[v]`, [W] (1), with an offset c beside it.

    Its loops are symmetric about their centres and alike wherever they lie. Slope of the output on a
    reversal: p_0; after a long way: :math:`p_0 + \sum p_i`. `origin`: input at which the unused device is
    [unit of the input], 0 but for an inverse, whose input is the output of what it inverts.
    """

    gain: Scalar = parameter("{output}/{input}", "output per input without memory, p0")
    weights: Weights = parameter("{output}/{input}", "weights of the play operators, p_i")
    thresholds: Weights = parameter("{input}", "half-widths of the play operators, r_i", nonnegative=True)
    offset: Scalar = parameter("{output}", "output of the unused device at input 0", default=0.0)
    origin: Scalar = eqx.field(converter=lambda value: jnp.asarray(value, dtype=float), default=0.0)  # pyright: ignore

    def rest(self) -> Weights:
        return jnp.full_like(self.thresholds, self.origin)

    def update(self, memory: Weights, value: Scalar) -> Weights:
        return play(memory, value, self.thresholds)

    def output(self, memory: Weights, value: Scalar) -> Scalar:
        return self.offset + self.gain * value + self.weights @ play(memory, value, self.thresholds)


class ExponentialPrandtlIshlinskii(AbstractHysteresis):
    r"""Classical model of [W] (1, 3, 5): :math:`r_i = α i`, :math:`p_i = ρ e^{-τ r_i}`, i = 1 … operators."""

    gain: Scalar = parameter("{output}/{input}", "output per input without memory, p0")
    density: Scalar = parameter("{output}/{input}", "density of the thresholds at 0, ρ")
    decay: Scalar = parameter("1/{input}", "decay of the density, τ")
    spacing: Scalar = parameter("{input}", "distance of the thresholds, α", positive=True)
    offset: Scalar = parameter("{output}", "output of the unused device at input 0", default=0.0)
    operators: int = eqx.field(static=True, default=10)

    def expanded(self) -> PrandtlIshlinskii:
        """The same model by its weights and thresholds."""
        thresholds = spaced_thresholds(self.spacing, self.operators)
        weights = exponential_density(thresholds, self.density, self.decay)
        return PrandtlIshlinskii(self.gain, weights, thresholds, self.offset)

    def rest(self) -> Weights:
        return jnp.zeros(self.operators)

    def update(self, memory: Weights, value: Scalar) -> Weights:
        return self.expanded().update(memory, value)

    def output(self, memory: Weights, value: Scalar) -> Scalar:
        return self.expanded().output(memory, value)
