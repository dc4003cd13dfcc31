"""The modified Prandtl-Ishlinskii model of [W]: play operators between unequal envelopes."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.hysteresis.base import AbstractHysteresis
from jaxmuscle.hysteresis.classical import Weights, exponential_density, spaced_thresholds
from jaxmuscle.hysteresis.operators import enveloped_play
from jaxmuscle.parameters import Scalar, parameter


class Envelope(eqx.Module):
    r"""Envelope of a play operator: :math:`γ(v) = a_0 \tanh(a_1 v + a_2) + a_3`, [W] (4).

    It rises where a_0 a_1 > 0, which the exactness of the operators at any step size asks for.
    """

    height: Scalar = parameter("", "half of what the envelope climbs, a0 or b0")
    slope: Scalar = parameter("1/{input}", "steepness over the input, a1 or b1")
    shift: Scalar = parameter("", "argument at input 0, a2 or b2", default=0.0)
    level: Scalar = parameter("", "value at the middle, a3 or b3", default=0.0)

    def __call__(self, value: Float[Array, "..."]) -> Float[Array, "..."]:
        """The envelope at an input."""
        return self.height * jnp.tanh(self.slope * value + self.shift) + self.level


class ModifiedPrandtlIshlinskii(AbstractHysteresis):
    r"""Modified model of [W] (2-6): :math:`z = p_1 v + p_2 v^3 + \sum_i ρ e^{-τ r_i} F_{γ, r_i}[v]`.

    The operators climb along γ_l (`rising`) and come down along γ_r (`falling`), r_i = α i, i = 1 …
    `operators` (the number is not given in [W]). The exponent 3 is a reading: it is not legible in [W].
    Loops between the same inputs are congruent, as in the classical model; loops of the same width at
    different inputs are not.
    """

    rising: Envelope
    falling: Envelope
    density: Scalar = parameter("{output}", "density of the thresholds at 0, ρ")
    decay: Scalar = parameter("", "decay of the density, τ")
    spacing: Scalar = parameter("", "distance of the thresholds, α", positive=True)
    linear: Scalar = parameter("{output}/{input}", "linear part without memory, p1", default=0.0)
    cubic: Scalar = parameter("{output}/{input}^3", "cubic part without memory, p2", default=0.0)
    operators: int = eqx.field(static=True, default=10)

    @property
    def thresholds(self) -> Weights:
        """Half-widths of the operators, in the unit of the envelopes."""
        return spaced_thresholds(self.spacing, self.operators)

    def rest(self) -> Weights:
        return jnp.zeros(self.operators)

    def update(self, memory: Weights, value: Scalar) -> Weights:
        return enveloped_play(memory, self.rising(value), self.falling(value), self.thresholds)

    def output(self, memory: Weights, value: Scalar) -> Scalar:
        weights = exponential_density(self.thresholds, self.density, self.decay)
        return self.linear * value + self.cubic * value**3 + weights @ self.update(memory, value)


class GeneralizedPrandtlIshlinskii(AbstractHysteresis):
    r"""Play operators between envelopes, with free weights: :math:`z = c + p_0 v + \sum_i p_i F_{γ, r_i}[v]`.

    The generalized model of Al Janaideh, Rakheja and Su (IEEE/ASME Trans. Mechatronics 16, 2011), of which
    [W]'s is the one with an exponential density. Two saturating envelopes make a saturating loop.
    """

    rising: Envelope
    falling: Envelope
    weights: Weights = parameter("{output}", "weights of the play operators, p_i")
    thresholds: Weights = parameter("", "half-widths of the play operators, r_i", nonnegative=True)
    gain: Scalar = parameter("{output}/{input}", "output per input without memory, p0", default=0.0)
    offset: Scalar = parameter("{output}", "constant part of the output, c", default=0.0)

    def rest(self) -> Weights:
        return jnp.zeros_like(self.thresholds)

    def update(self, memory: Weights, value: Scalar) -> Weights:
        return enveloped_play(memory, self.rising(value), self.falling(value), self.thresholds)

    def output(self, memory: Weights, value: Scalar) -> Scalar:
        return self.offset + self.gain * value + self.weights @ self.update(memory, value)
