"""The integral inverse of [W]: a model run inside a controller, whose input is integrated until it fits."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.hysteresis.base import AbstractHysteresis
from jaxmuscle.parameters import Scalar, parameter


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


def inverted(
    inverse: IntegralInverse, targets: Float[Array, " samples"], step: float | Scalar, value: float = 0.0
) -> Float[Array, " samples"]:
    """The inputs with which the inverse follows a series of target outputs, from the input `value` on."""

    def onward(state: Inverting, target: Scalar) -> tuple[Inverting, Scalar]:
        return inverse.update(state, target, step)

    return jax.lax.scan(onward, inverse.start(value), jnp.asarray(targets, dtype=float))[1]
