"""Hysteresis compensation: the analytic inverse of the classical model, and the integral inverse of [W],
a model run inside a controller, whose input is integrated until it fits.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.operators import AbstractHysteresis
from jaxmuscle.hysteresis.prandtl_ishlinskii import PrandtlIshlinskii, Weights
from jaxmuscle.parameters import Scalar, parameter


def inverse(model: PrandtlIshlinskii) -> PrandtlIshlinskii:
    r"""The model that takes the output of `model` back to its input, exactly.

    With the slopes of the loading curve :math:`s_i = p_0 + \sum_{j \le i} p_j`:

    .. math:: q_0 = \frac1{p_0},\quad q_i = \frac1{s_i} - \frac1{s_{i-1}},\quad
              r'_i = p_0 r_i + \sum_{j < i} p_j (r_i - r_j)

    (Krejčí and Kuhnen, IEE Proc. Control Theory Appl. 148, 2001). Unused, the inverse is at the output of
    the unused model, which is c at input 0: its `origin`. Used ones start with memories that belong
    together: :func:`inverse_memory`.

    Raises:
        InputError: the thresholds do not increase from 0 on, or some slope is not above zero: then the output
            does not rise with the input, and nothing can be inverted.
    """
    slopes = _checked_slopes(model)
    compliances = 1 / slopes
    gaps = jnp.diff(model.thresholds, prepend=0.0)
    thresholds = jnp.cumsum(slopes[:-1] * gaps)
    offset, origin = -model.offset * compliances[-1], model.offset + slopes[-1] * model.origin
    return PrandtlIshlinskii(compliances[0], jnp.diff(compliances), thresholds, offset, origin)


def inverse_memory(model: PrandtlIshlinskii, memory: Weights) -> Weights:
    r"""Memory of the inverse that belongs to a memory F of `model`.

    .. math:: F'_i = c + s_i F_i + \sum_{j > i} p_j F_j
    """
    part = model.weights * memory
    later = part.sum() - jnp.cumsum(part)
    return model.offset + (model.gain + jnp.cumsum(model.weights)) * memory + later


def _checked_slopes(model: PrandtlIshlinskii) -> Weights:
    slopes = jnp.concatenate([model.gain[None], model.gain + jnp.cumsum(model.weights)])
    if isinstance(slopes, jax.core.Tracer) or isinstance(model.thresholds, jax.core.Tracer):
        return slopes
    if not bool(jnp.all(jnp.diff(model.thresholds) > 0) & (model.thresholds[0] >= 0)):
        raise InputError(
            f"the inverse needs thresholds that increase from 0 on; got {model.thresholds}; sort them"
        )
    if not bool(jnp.all(slopes > 0)):
        raise InputError(
            "the inverse needs an output that rises with the input: p0 and all sums p0 + p1 + … above zero; "
            f"got {slopes}; use an integral inverse, or constrain the fit"
        )
    return slopes


class Inverting(eqx.Module):
    """State of an integral inverse: the input it has reached and the memory of its model."""

    value: Scalar
    memory: Any


class IntegralInverse(eqx.Module):
    r"""Integral inverse, [W] (7): :math:`u_1 = K \int (y_d - y_{model})\,dt`.

    The model is Γ[u_1], so that y_model → y_d without an analytic inverse. Where the model's output rises
    with slope s the error decays with rate K s; stable while K s · step < 2.
    """

    model: AbstractHysteresis
    gain: Scalar = parameter("{input}/{output}/s", "input per output and second, K", positive=True)

    def start(self, value: float | Array = 0.0) -> Inverting:
        """An unused model at the input `value`."""
        value = jnp.asarray(value, dtype=float)
        return Inverting(value, self.model.update(self.model.rest(), value))

    def update(self, state: Inverting, target: Scalar, step: float | Scalar) -> tuple[Inverting, Scalar]:
        """The state after `step` seconds towards the output `target`, and the input u_1 for the device."""
        error = target - self.model.output(state.memory, state.value)
        value = state.value + self.gain * step * error
        return Inverting(value, self.model.update(state.memory, value)), value

    def limited(self, before: Inverting, after: Inverting, lowest: Scalar, highest: Scalar) -> Inverting:
        """The state after a sample whose input, that of the device, goes to a limit and no further."""
        value = jnp.clip(after.value, lowest, highest)
        return Inverting(value, self.model.update(before.memory, value))


class AnalyticInverse(eqx.Module):
    """The analytic :func:`inverse` of a model as it runs inside a controller, as an :class:`IntegralInverse`.

    Attributes:
        model: the inverse, not what it inverts; the device has to be unused when it starts.
    """

    model: PrandtlIshlinskii

    def start(self) -> Weights:
        """The memory of the unused inverse."""
        return self.model.rest()

    def update(self, state: Weights, target: Scalar, step: float | Scalar) -> tuple[Weights, Scalar]:
        """The memory after the output `target`, and the input for the device."""
        memory = self.model.update(state, target)
        return memory, self.model.output(memory, target)


def inverted(
    inverse: IntegralInverse, targets: Float[Array, " samples"], step: float | Scalar, value: float = 0.0
) -> Float[Array, " samples"]:
    """The inputs with which the inverse follows a series of target outputs, from the input `value` on."""

    def onward(state: Inverting, target: Scalar) -> tuple[Inverting, Scalar]:
        return inverse.update(state, target, step)

    return jax.lax.scan(onward, inverse.start(value), jnp.asarray(targets, dtype=float))[1]
