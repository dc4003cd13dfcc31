"""An exponential Runge-Kutta method for diffrax: a fast linear part of a machine is integrated exactly.

A lightly damped resonance binds an explicit method to steps far shorter than anything that is sampled, and
Chebyshev's lie along the wrong axis. Where the fast part is linear with constant coefficients,
y' = A y + N(t, y), the second-order method ETD2RK of Cox and Matthews (J. Comput. Phys. 176, 2002,
equations 20 to 22) needs the exponential of A once a run and two evaluations a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from diffrax import RESULTS
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

Matrix = Float[Array, "n n"]
Functions = tuple[Matrix, Matrix, Matrix]

SMALL, DEGREE = 0.5, 12
"""Norm up to which a series of this degree is exact to rounding: what follows is below 10⁻¹⁶."""
MOST_HALVINGS = 24
"""Halvings of a step at most; as many doublings are always computed, for derivatives in both directions."""


class Propagator(eqx.Module):
    r"""What one step of width h needs of A: :math:`e^{Ah}`, :math:`h φ_1(Ah)`, :math:`h φ_2(Ah)`.

    :math:`φ_1(z) = (e^z - 1)/z,\ φ_2(z) = (φ_1(z) - 1)/z`.
    """

    matrix: Matrix
    whole: Matrix
    first: Matrix
    second: Matrix


def propagator(matrix: Matrix, width: Array) -> Propagator:
    r"""The propagator of `matrix` over steps of `width`, by scaling and modified squaring.

    Of :math:`z = Ah/2^s` with a norm up to 1/2 the series :math:`φ_2(z) = \sum_k z^k/(k+2)!` gives
    :math:`φ_1 = z φ_2 + 1` and :math:`e^z = z φ_1 + 1`. Then s times :math:`e^{2z} = (e^z)^2`,
    :math:`φ_1(2z) = (e^z φ_1 + φ_1)/2` and :math:`φ_2(2z) = (e^z φ_2 + φ_1 + φ_2)/4` (Skaflestad and Wright,
    "The scaling and modified squaring method for matrix functions related to the exponential", Appl. Numer.
    Math. 59, 2009).

    Products alone, since `jax.scipy.linalg.expm` calls LAPACK: of a batch of matrices jaxlib 0.10 hands parts
    to XLA's threads and waits for them on one of these, and as many batches at a time as there are threads
    wait for ever. Not a number where the norm of Ah is beyond 2²³.
    """
    one, scaled = jnp.eye(matrix.shape[0]), width * matrix
    norm = jax.lax.stop_gradient(jnp.abs(scaled).sum(axis=0).max())
    halvings = jnp.ceil(jnp.log2(jnp.maximum(norm, SMALL) / SMALL))
    z = jnp.where(halvings <= MOST_HALVINGS, scaled, jnp.nan) * 2.0**-halvings
    second = one / math.factorial(DEGREE + 2)
    for power in reversed(range(DEGREE)):
        second = z @ second + one / math.factorial(power + 2)
    first = z @ second + one

    def doubled(number: Array, now: Functions) -> Functions:
        whole, first, second = now
        twice = whole @ whole, (whole @ first + first) / 2, (whole @ second + first + second) / 4
        return jax.tree.map(lambda new, old: jnp.where(number < halvings, new, old), twice, now)

    whole, first, second = jax.lax.fori_loop(0, MOST_HALVINGS, doubled, (z @ first + one, first, second))
    return Propagator(matrix, whole, width * first, width * second)


class ExponentialHeun(diffrax.AbstractSolver):
    """ETD2RK over steps of the width for which its propagator was made; Heun's method where A is zero."""

    propagator: Propagator
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., Any]] = diffrax.LocalLinearInterpolation

    def order(self, terms: object) -> int:
        """Order of the method."""
        return 2

    def init(self, terms, t0, t1, y0, args) -> None:
        """Nothing is carried from step to step."""

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from `t0` to `t1`."""
        del solver_state, made_jump
        p = self.propagator
        begin, unpack = ravel_pytree(y0)
        field = lambda time, y: ravel_pytree(terms.vf(time, unpack(y), args))[0]  # noqa: E731
        before = field(t0, begin) - p.matrix @ begin
        first = p.whole @ begin + p.first @ before
        after = field(t1, first) - p.matrix @ first
        y1 = unpack(first + p.second @ (after - before))
        return y1, None, {"y0": y0, "y1": y1}, None, RESULTS.successful

    def func(self, terms, t0, y0, args) -> Any:
        """The vector field."""
        return terms.vf(t0, y0, args)
