"""The only door to optimistix: least squares through the simulation."""

from __future__ import annotations

import dataclasses
from typing import Any

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

TOLERANCE = 3e-4
"""Relative fall of the cost over one accepted step at which a fit ends."""
FIRST_DAMPING = 1e-3
"""Damping of the first step, relative to the squared norm of the residuals there."""
REJECTIONS = 12
"""Steps rejected in a row after which a fit ends: the trust region has shrunk by 4 to that power."""


@dataclasses.dataclass(frozen=True)
class Minimum:
    """Where a fit ended: coordinates z of all parameters, cost (half the sum of squares), convergence."""

    z: NDArray[np.float64]
    cost: float
    converged: bool
    steps: int


def minimise(
    model: AbstractActuator, problem: Problem, free: Free, chosen: NDArray[np.int64], width: int, steps: int
) -> Minimum:
    """Levenberg-Marquardt over the entries `chosen` of `free`, in forward mode.

    The number of tangents is always `width`, padded with coordinates that do nothing, so that fits of
    different parameters of one model share one compilation. A fit that does not converge within `steps`
    steps says so and keeps the best point.

    Raises:
        ValueError: more entries are chosen than `width`.
    """
    if len(chosen) > width:
        raise ValueError(f"{len(chosen)} parameters are free, but the fit was laid out for {width}")
    select = np.zeros((len(free.paths), width))
    select[chosen, np.arange(len(chosen))] = 1.0
    start = max(float(_cost(model, problem, free)), 1e-300)
    y, relative, taken, converged = _solve(
        model, problem, free, jnp.asarray(select), jnp.asarray(steps), jnp.asarray(start)
    )
    cost = start * float(relative)
    return Minimum(select @ np.asarray(y), cost, bool(converged) and bool(np.isfinite(cost)), int(taken))


@eqx.filter_jit
def _cost(model: AbstractActuator, problem: Problem, free: Free) -> Array:
    """Half the sum of squares at z = 0."""
    return 0.5 * (residual_vector(model, problem, free, jnp.zeros(len(free.paths))) ** 2).sum()


@eqx.filter_jit
def _solve(
    model: AbstractActuator, problem: Problem, free: Free, select: Array, limit: Array, start: Array
) -> tuple[Array, Array, Array, Array]:
    """Run optimistix's solver step by step: its own test waits for every coordinate, even one without effect.

    The residuals are scaled by their norm at the start. optimistix begins with a damping of 1: against the
    sensitivities of a wrong model in units of the sensors' noise that is nothing, and a dozen steps would be
    rejected before it counts. Scaled so, it is :data:`FIRST_DAMPING` of the squared norm.
    """
    unit = jnp.sqrt(2 * FIRST_DAMPING * start)

    def stacked(y: Array, _: None) -> tuple[Array, None]:
        return residual_vector(model, problem, free, select @ y) / unit, None

    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    options, tags = {"jac": "fwd"}, frozenset()
    y = jnp.zeros(select.shape[1])
    fn = eqx.filter_closure_convert(stacked, y, None)
    shape, aux = jax.eval_shape(fn, y, None)
    first: Any = solver.init(fn, y, None, options, shape, aux, tags)
    moving, fixed = eqx.partition(first, eqx.is_array)

    def cost(state: Any) -> Array:
        return FIRST_DAMPING * (state.f_info.residual**2).sum()

    def going(carry: tuple[Array, Any, Array]) -> Array:
        _, state, settled = carry
        tired = state.num_steps_since_acceptance >= REJECTIONS
        return (state.num_steps < limit) & ~settled & ~tired

    def step(carry: tuple[Array, Any, Array]) -> tuple[Array, Any, Array]:
        y, moving, _ = carry
        before = eqx.combine(moving, fixed)
        y, after, _ = solver.step(fn, y, None, options, before, tags)  # pyright: ignore
        accepted = (after.num_accepted_steps > before.num_accepted_steps) & (before.num_accepted_steps > 0)
        settled = accepted & (cost(after) > (1 - TOLERANCE) * cost(before))
        return y, eqx.partition(after, eqx.is_array)[0], settled

    y, moving, settled = jax.lax.while_loop(going, step, (y, moving, jnp.asarray(False)))
    tired = moving.num_steps_since_acceptance >= REJECTIONS
    return y, cost(moving), moving.num_steps, settled | tired


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
