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
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.fitting.vector import Scaled, scaled, stacked, vector_at_zero
from jaxmuscle.xla_options import compact

TOLERANCE = 3e-4
"""Relative fall of the cost over one accepted step at which a fit ends."""
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
    coordinates = scaled(model, problem, free, chosen, width)
    y, cost, taken, converged, _ = _solve(coordinates, jnp.asarray(steps))
    cost, z = float(cost), np.asarray(coordinates.select) @ np.asarray(y)
    return Minimum(z, cost, bool(converged) and bool(np.isfinite(cost)), int(taken))


def sensitivities(
    model: AbstractActuator, problem: Problem, free: Free, chosen: NDArray[np.int64], width: int
) -> tuple[Float[np.ndarray, " residuals"], Float[np.ndarray, "chosen residuals"]]:
    """Residual vector at z = 0 and its derivatives with respect to the entries `chosen`, by forward mode.

    They come out of the first step of :func:`minimise`, so that nothing is compiled for them alone.
    """
    rows = []
    for first in range(0, len(chosen), width):
        part = chosen[first : first + width]
        *_, slopes = _solve(scaled(model, problem, free, part, width), jnp.asarray(1))
        rows.append(np.asarray(slopes)[: len(part)])
    return vector_at_zero(model, problem, free), np.concatenate(rows)


@eqx.filter_jit(compiler_options=compact())  # pyright: ignore[reportCallIssue]
def _solve(scaled: Scaled, limit: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Run optimistix's solver step by step: its own test waits for every coordinate, even one without effect.

    Returns y, the cost there, steps taken, whether it settled, and the slopes of the residuals there.
    """

    def fn(y: Array, scaled: Scaled) -> tuple[Array, None]:
        return stacked(y, scaled), None

    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    options, tags = {"jac": "fwd"}, frozenset()
    y = jnp.zeros(scaled.select.shape[1])
    shape, aux = eqx.filter_eval_shape(fn, y, scaled)
    first: Any = solver.init(fn, y, scaled, options, shape, aux, tags)
    moving, fixed = eqx.partition(first, eqx.is_array)

    def cost(state: Any) -> Array:
        return 0.5 * scaled.unit**2 * (state.f_info.residual**2).sum()

    def going(carry: tuple[Array, Any, Array]) -> Array:
        _, state, settled = carry
        tired = state.num_steps_since_acceptance >= REJECTIONS
        return (state.num_steps < limit) & ~settled & ~tired

    def step(carry: tuple[Array, Any, Array]) -> tuple[Array, Any, Array]:
        y, moving, _ = carry
        before = eqx.combine(moving, fixed)
        y, after, _ = solver.step(fn, y, scaled, options, before, tags)  # pyright: ignore
        accepted = (after.num_accepted_steps > before.num_accepted_steps) & (before.num_accepted_steps > 0)
        settled = accepted & (cost(after) > (1 - TOLERANCE) * cost(before))
        return y, eqx.partition(after, eqx.is_array)[0], settled

    y, moving, settled = jax.lax.while_loop(going, step, (y, moving, jnp.asarray(False)))
    tired = moving.num_steps_since_acceptance >= REJECTIONS
    slopes = scaled.unit * jax.vmap(eqx.combine(moving, fixed).f_info.jac.mv)(jnp.eye(len(y)))
    return y, cost(moving), moving.num_steps, settled | tired, slopes
