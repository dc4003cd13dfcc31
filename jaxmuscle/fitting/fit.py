"""The only door to optimistix: least squares through the simulation."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.free import Free
from jaxmuscle.fitting.problem import Problem, residuals

TOLERANCE = 1e-3
"""Relative change of cost and of coordinates (in prior deviations) at which a fit ends."""
STEPS = 12
"""Levenberg-Marquardt steps of one call; longer fits call again from where they are."""


@dataclasses.dataclass(frozen=True)
class Minimum:
    """Where a fit ended: coordinates z of all parameters, cost (half the sum of squares), whether it converged."""

    z: NDArray[np.float64]
    cost: float
    converged: bool
    steps: int


def minimise(
    model: AbstractActuator, problem: Problem, free: Free, chosen: NDArray[np.int64], width: int, steps: int
) -> Minimum:
    """Levenberg-Marquardt over the entries `chosen` of `free`, in forward mode.

    The number of tangents is always `width`, padded with coordinates that do nothing, so that fits of
    different parameters of one model share one compilation.

    Raises:
        ValueError: more entries are chosen than `width`.
    """
    if len(chosen) > width:
        raise ValueError(f"{len(chosen)} parameters are free, but the fit was laid out for {width}")
    select = np.zeros((len(free.paths), width))
    select[chosen, np.arange(len(chosen))] = 1.0
    y = jnp.zeros(width)
    taken, done, cost = 0, False, np.inf
    while taken < steps and not done:
        y, new_cost, count, converged = _solve(model, problem, free, jnp.asarray(select), y)
        taken += int(count)
        done = bool(converged) or float(new_cost) > (1 - TOLERANCE) * cost
        cost = float(new_cost)
    return Minimum(select @ np.asarray(y), cost, done and np.isfinite(cost), taken)


@eqx.filter_jit
def _solve(model: AbstractActuator, problem: Problem, free: Free, select: Array, y: Array):
    def stacked(y: Array, _: None) -> Array:
        return residual_vector(model, problem, free, select @ y)

    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    solution = optx.least_squares(stacked, solver, y, max_steps=STEPS, throw=False, options={"jac": "fwd"})
    cost = 0.5 * (solution.state.f_info.residual**2).sum()
    converged = solution.result == optx.RESULTS.successful
    return solution.value, cost, solution.stats["num_steps"], converged


def residual_vector(model: AbstractActuator, problem: Problem, free: Free, z: Array) -> Array:
    """All weighted residuals and the distances from the priors, as one vector."""
    parts = residuals(free.apply(model, z), problem)
    return jnp.concatenate([*(part.ravel() for part in parts.values()), free.prior_residuals(z)])


@eqx.filter_jit
def sensitivities(
    model: AbstractActuator, problem: Problem, free: Free, z: Array, directions: Float[Array, "k parameters"]
) -> tuple[Array, Float[Array, "k residuals"]]:
    """Residual vector at z and its derivatives along `directions`, by forward mode."""

    def vector(z: Array) -> Array:
        return residual_vector(model, problem, free, z)

    value, push = jax.linearize(vector, z)
    return value, jax.vmap(push)(directions)
