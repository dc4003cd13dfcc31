"""A root finder for optimistix that goes to a root the way a machine settles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from jaxmuscle.analysis.elimination import solve

Vector = Float[Array, " n"]
FIRST_STEP, GROWTH, EULER_STEPS = 1e-4, 1.6, 60
"""Time steps on the way to rest: the first [s], the factor between two, their number; Newton's follow."""


class Settled(eqx.Module):
    """How far it is: steps made, and the last one relative to what is allowed of it."""

    count: Int[Array, ""]
    size: Float[Array, ""]


class Settling(optx.AbstractRootFinder):
    r"""Implicit Euler steps of :math:`\dot x = f(x)`, one Newton iteration each, ever longer, and at last
    Newton's own, the Euler step of infinite length (pseudo-transient continuation: Kelley and Keyes, SIAM J.
    Numer. Anal. 35, 1998).

    .. math:: x_{k+1} = x_k + (I/h_k - f'(x_k))^{-1} f(x_k)

    Ends where a step of Newton's is below `atol` + `rtol`\|x\| in every component. All in one loop, so that
    the function is compiled once.
    """

    rtol: float = 1e-9
    atol: float = 1e-12
    norm: Callable[[Any], Any] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> Settled:
        """Nothing has been done."""
        return Settled(jnp.asarray(0), jnp.asarray(jnp.inf))

    def step(self, fn, y, args, options, state: Settled, tags) -> tuple[Vector, Settled, Any]:
        """The next point on the way."""

        def twice(x: Vector) -> tuple[Vector, tuple[Vector, Any]]:
            value, aux = fn(x, args)
            return value, (value, aux)

        slopes, (value, aux) = jax.jacfwd(twice, has_aux=True)(y)
        euler = state.count < EULER_STEPS
        inverse = jnp.where(euler, GROWTH ** (-1.0 * state.count) / FIRST_STEP, 0.0)
        move = solve(inverse * jnp.eye(y.size) - slopes, value)
        size = self.norm(move / (self.atol + self.rtol * jnp.abs(y + move)))
        return y + move, Settled(state.count + 1, jnp.where(euler, jnp.inf, size)), aux

    def terminate(self, fn, y, args, options, state: Settled, tags) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether to stop, and with what result."""
        lost = ~jnp.isfinite(y).all()
        result = optx.RESULTS.where(lost, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return lost | (state.size < 1), result

    def postprocess(
        self, fn, y, aux, args, options, state, tags, result
    ) -> tuple[Vector, Any, dict[str, Any]]:
        """The point as it is."""
        return y, aux, {}
