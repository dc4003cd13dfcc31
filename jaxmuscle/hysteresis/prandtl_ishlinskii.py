"""Prandtl-Ishlinskii models: classical, generalized, modified [W], and the elbow that [W] identified
(Wang et al. 2019, Tables 1 and 2).
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.hysteresis.operators import AbstractHysteresis, enveloped_play, play
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


PUBLISHED_ERRORS = {"classical": 0.2267, "modified": 0.0465}
"""Largest errors relative to the range of the angle on the measured loops of [W], text after Table 2."""
UNSTATED_SPACING = 0.25
"""Distance of the thresholds of the classical model: Table 1 gives none, so that of Table 2 stands in."""


def elbow_classical(operators: int = 10) -> ExponentialPrandtlIshlinskii:
    """Classical model of the elbow, [W] Table 1. Angle in degrees; the unit of the input is not stated.

    Neither the number of operators nor the spacing is: the latter is that of Table 2 here.
    """
    kind: Any = ExponentialPrandtlIshlinskii  # its converters make arrays of the numbers
    return kind(-8.223, 12.407, 6.529, UNSTATED_SPACING, operators=operators)


def elbow_modified(operators: int = 10) -> ModifiedPrandtlIshlinskii:
    """Modified model of the elbow, [W] Table 2. Angle in degrees; the unit of the input is not stated.

    α, p1 and p2 are assigned as the order of a broken table suggests. Read as written, no unit of the input
    gives the 0 to 90 degrees of [W] over 0 to 0.6 MPa: the numbers test the equations, they are no elbow.
    """
    envelope: Any = Envelope
    kind: Any = ModifiedPrandtlIshlinskii
    rising = envelope(7.313, 0.381, -0.085, -2.050)
    falling = envelope(1.790, 0.816, -1.588, -0.696)
    return kind(rising, falling, 17.371, 2.092, 0.250, 0.777, -0.819, operators)
