"""The analytic inverse of the classical model, which is a classical model again."""

from __future__ import annotations

import jax.core
import jax.numpy as jnp

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.classical import PrandtlIshlinskii, Weights


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
