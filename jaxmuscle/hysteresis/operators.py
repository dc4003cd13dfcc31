"""Rate-independent hysteresis: the interface of a model, and the play, stop, Dahl and Bouc-Wen operators.

Each takes its memory and the next input and returns the new memory. They depend on the way that the input
has gone, not on how fast: a straight way in one step or in a thousand gives the same value.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

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


Operators = Float[Array, "..."]
"""One operator, or several along the last axis."""
Thresholds = NDArray | Operators
Inputs = Float[Array, "..."]
"""One input for all operators, or one for each of them."""


def play(memory: Operators, value: Inputs, threshold: Thresholds) -> Operators:
    r"""Play operator: :math:`F = \max(v - r, \min(v + r, F^-))`, [W] before (1).

    Args:
        memory: F⁻, what the operators were before [unit of the input].
        value: v, the input now.
        threshold: half-widths r ≥ 0.

    Cases are told apart by comparison: maxima and minima halve their slopes where two are alike, at rest for
    r = 0, and take a division for every tangent of a Jacobian.
    """
    gap = value - memory
    return jnp.where(
        gap >= threshold, value - threshold, jnp.where(gap <= -threshold, value + threshold, memory)
    )


def stop(memory: Operators, value: Inputs, threshold: Thresholds) -> Operators:
    r"""Stop operator, what the play leaves of its input: :math:`E = v - F = \max(-r, \min(r, v - F^-))`.

    `memory` is that of the play operator.
    """
    gap = value - memory
    return jnp.where(gap >= threshold, threshold, jnp.where(gap <= -threshold, -threshold, gap))


def enveloped_play(
    memory: Operators,
    rising: Inputs,
    falling: Inputs,
    threshold: Thresholds,
) -> Operators:
    r"""Play between two envelopes: :math:`F = \max(γ_l(v) - r, \min(γ_r(v) + r, F^-))`, [W] (4).

    Args:
        memory: F⁻.
        rising: γ_l(v), along which the operator goes up, `threshold` below it.
        falling: γ_r(v), along which it comes down, `threshold` above it.
        threshold: r ≥ 0. Where γ_l - r lies above γ_r + r the operator has no memory and is γ_l - r.

    Exact at any step size if both envelopes rise. With γ_l = γ_r = v it is :func:`play`.
    """
    return jnp.maximum(rising - threshold, jnp.minimum(falling + threshold, memory))


def dahl(memory: ArrayLike, move: ArrayLike, distance: ArrayLike) -> Array:
    r"""Dahl's presliding: :math:`dz/dx = (1 - z\,\mathrm{sgn}\,dx)/d`, integrated over a straight move.

    Args:
        memory: z before the move, -1 … 1: the share of the Coulomb friction that acts.
        move: Δx.
        distance: d, over which the friction turns round, in the unit of x.

    Returns:
        :math:`z = s + (z^- - s) e^{-|Δx|/d}` with s the sign of the move (Dahl, 1968, exponent 1).
    """
    return dahl_between_limits(memory, move, distance, 1.0, 1.0)


SHORT = 1e-3
"""Way over that of bristles up to which a series is good to the last bits."""


def dahl_between_limits(
    memory: ArrayLike, move: ArrayLike, distance: ArrayLike, before: ArrayLike, after: ArrayLike
) -> Array:
    r"""Bend of bristles over a straight move along which the friction's limit changes evenly:
    :math:`db/dx = (1 - (b/c)\,\mathrm{sgn}\,dx)/d`, c from `before` to `after`.

    Args:
        memory: b before the move, the share of the limit at rest that acts.
        move: Δx.
        distance: d, over which bristles of the limit at rest bend, in the unit of x.
        before, after: c at both ends of the move, positive.

    Returns:
        With s the sign of the move and :math:`r = |Δx|/(d \bar c)`, :math:`\bar c` the mean of both limits,
        :math:`b = s c_1 + (b^- - s c_0) e^{-r} - s (c_1 - c_0)(1 - e^{-r})/r` (exponential integrator,
        Hochbruck and Ostermann, Acta Numerica 19, 2010): bristles lag behind a limit that changes by
        :math:`d\,c\,dc/dx`. Exact, and :func:`dahl`, where both limits are alike.
    """
    bend, way = jnp.asarray(memory, dtype=float), jnp.asarray(move, dtype=float)
    sense = jnp.sign(way)
    r = sense * way / (distance * (jnp.asarray(before) + after) / 2)
    gone = -jnp.expm1(-r)
    # The quotient's slope cancels where hardly anything moves: there the series of (1 - e^-r)/r.
    some = r > SHORT
    series = 1 - r / 2 * (1 - r / 3 * (1 - r / 4))
    lag = jnp.where(some, gone / jnp.where(some, r, 1.0), series)
    return bend + gone * (sense * before - bend) + sense * (jnp.asarray(after) - before) * (1.0 - lag)


def bouc_wen(memory: ArrayLike, move: ArrayLike, distance: ArrayLike) -> Array:
    r"""Bouc-Wen's hysteretic variable, integrated over a straight move, with exponent 1 and β = γ = 1/2:
    :math:`dz/dx = [1 - |z|\,(1 + \mathrm{sgn}(z\,dx))/2]/d`.

    Args:
        memory: z before the move, -1 … 1.
        move: Δx.
        distance: d, over which z builds up, in the unit of x.

    Returns:
        z after it: linear while it falls to zero, from there on as :func:`dahl` (Wen, J. Eng. Mech. Div.
        102, 1976).
    """
    before, way = jnp.asarray(memory, dtype=float), jnp.asarray(move, dtype=float)
    sense = jnp.where(way < 0, -1.0, 1.0)
    ahead, length = sense * before, sense * way / distance
    elastic = jnp.minimum(length, jnp.maximum(-ahead, 0.0))
    unloaded = ahead + elastic
    return sense * (unloaded - (1 - unloaded) * jnp.expm1(elastic - length))
