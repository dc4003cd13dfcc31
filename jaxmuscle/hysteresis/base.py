"""What every model of hysteresis here is: a memory, its update by an input, and an output."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.errors import InputError


class AbstractHysteresis(eqx.Module):
    """A rate-independent map from an input v to an output z with a memory.

    All methods take one scalar input; `jax.vmap` runs several models or inputs side by side.
    """

    @abc.abstractmethod
    def rest(self) -> Any:
        """The memory of a device that has not been used yet: input 0, as far as it goes."""

    @abc.abstractmethod
    def update(self, memory: Any, value: Float[Array, ""]) -> Any:
        """The memory after the input has gone straight to `value`."""

    @abc.abstractmethod
    def output(self, memory: Any, value: Float[Array, ""]) -> Float[Array, ""]:
        """The output when the input has gone straight from where `memory` was left to `value`."""


def respond(
    model: AbstractHysteresis, values: ArrayLike | Sequence[float], memory: Any = None
) -> tuple[Any, Float[Array, " samples"]]:
    """The memory after the last sample, and the output at every sample.

    Args:
        values: the input, shape (samples,), straight between its samples.
        memory: where to start; `rest()` when `None`.

    Raises:
        InputError: `values` is not a series.
    """
    series = jnp.asarray(values, dtype=float)
    if series.ndim != 1 or not series.size:
        raise InputError(
            f"expected a series of inputs, shape (samples,); got shape {series.shape}; "
            f"use jax.vmap for several"
        )

    def onward(memory: Any, value: Array) -> tuple[Any, Array]:
        return model.update(memory, value), model.output(memory, value)

    return jax.lax.scan(onward, model.rest() if memory is None else memory, series)
