"""Residuals and priors as one vector, as a function of the coordinates, with slopes traced only once."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.free import Free
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.fitting.residuals import evaluate, residuals

FIRST_DAMPING = 1e-3
"""Damping of the first step, relative to the squared norm of the residuals there."""


def residual_vector(model: AbstractActuator, problem: Problem, free: Free, z: Array) -> Array:
    """All weighted residuals, link by link, and the distances from the priors, as one vector."""
    return _joined(model, residuals(free.apply(model, z), problem), free.prior_residuals(z))


def vector_at_zero(model: AbstractActuator, problem: Problem, free: Free) -> NDArray[np.float64]:
    """The residual vector at z = 0."""
    zero = jnp.zeros(len(free.paths))
    parts = evaluate(free.apply(model, zero), problem)
    return np.asarray(_joined(model, parts, free.prior_residuals(zero)))  # pyright: ignore


class Scaled(eqx.Module):
    """Residuals of a machine as a function of `width` coordinates y, z = select y, divided by `unit`.

    optimistix begins with a damping of 1: against the sensitivities of a wrong model in units of the
    sensors' noise that is nothing, and a dozen steps would be rejected before it counts. With this unit it
    is :data:`FIRST_DAMPING` of the squared norm of the residuals at the start.
    """

    model: AbstractActuator
    problem: Problem
    free: Free
    select: Float[Array, "parameters width"]
    unit: Float[Array, ""]


def scaled(
    model: AbstractActuator, problem: Problem, free: Free, chosen: NDArray[np.int64], width: int
) -> Scaled:
    """The entries `chosen` of `free` as `width` coordinates, padded with some that do nothing."""
    select = np.zeros((len(free.paths), width))
    select[chosen, np.arange(len(chosen))] = 1.0
    squares = max(float((vector_at_zero(model, problem, free) ** 2).sum()), 1e-300)
    return Scaled(model, problem, free, jnp.asarray(select), jnp.sqrt(FIRST_DAMPING * squares))


@eqx.filter_jit
def _value_and_slopes(y: Array, scaled: Scaled) -> tuple[Array, Array]:
    """Scaled residuals and their derivatives along every coordinate: one simulation with all tangents.

    Compiled by itself so that it is traced once, wherever the solver differentiates.
    """

    def pushed(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda y: _values(y, scaled), (y,), (direction,))

    return jax.vmap(pushed, out_axes=(None, 0))(jnp.eye(len(y)))


def _values(y: Array, scaled: Scaled) -> Array:
    return residual_vector(scaled.model, scaled.problem, scaled.free, scaled.select @ y) / scaled.unit


@eqx.filter_custom_jvp
def stacked(y: Array, scaled: Scaled) -> Array:
    """What optimistix minimises.

    Its derivative is the matrix of all slopes: differentiating it, as the solver does wherever it looks at
    the function, costs one forward simulation and no new tracing.
    """
    return _value_and_slopes(y, scaled)[0]


@stacked.def_jvp
def _stacked_jvp(primals: tuple[Array, Scaled], tangents: tuple[Array, Any]) -> tuple[Array, Array]:
    value, slopes = _value_and_slopes(*primals)
    return value, tangents[0] @ slopes


def _joined(model: AbstractActuator, parts: Residuals, priors: Array) -> Array:
    # By the links: the order of a dictionary's entries does not survive compilation.
    return jnp.concatenate([*(parts[link.output].ravel() for link in model.links), priors])
