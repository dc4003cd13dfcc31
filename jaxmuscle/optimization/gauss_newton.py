"""A Gauss-Newton step within a compiled program, with derivatives in forward and reverse mode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from jaxmuscle._linalg import solve

Vector = Float[Array, " unknowns"]


class NormalStep(eqx.Module):
    """State of a descent: the step that is to be taken off."""

    step: Vector


class NormalEquations(optx.AbstractDescent):
    r"""The Gauss-Newton step :math:`(J^T J)^{-1} J^T r`, solved without LAPACK.

    For few unknowns and residuals that determine them well; batched LAPACK kernels of jaxlib may wait for
    each other for ever.
    """

    def init(self, y: Vector, f_info_struct: Any) -> NormalStep:
        """No step yet."""
        return NormalStep(jnp.zeros_like(y))

    def query(self, y: Vector, f_info: Any, state: NormalStep) -> NormalStep:
        """The step at a point."""
        jacobian = f_info.jac.as_matrix()
        return NormalStep(solve(jacobian.T @ jacobian, jacobian.T @ f_info.residual))

    def step(self, step_size: Array, state: NormalStep) -> tuple[Vector, optx.RESULTS]:
        """The move, and that it is one."""
        return -step_size * state.step, optx.RESULTS.successful


def _silent(**_: Any) -> None:
    """Tell nothing of a step."""


class GaussNewton(optx.AbstractGaussNewton):
    """Gauss and Newton's method with the normal equations and whole steps."""

    rtol: float = 1e-9
    atol: float = 1e-9
    norm: Callable[[Any], Any] = optx.max_norm
    descent: Any = NormalEquations()
    search: Any = optx.LearningRate(1.0)
    verbose: Callable[..., None] = _silent


def gauss_newton_step(residuals: Callable[[Vector], Float[Array, " residuals"]], at: Vector) -> Vector:
    """The point after one step from `at`."""

    def function(y: Vector, args: None) -> tuple[Array, None]:
        return residuals(y), None

    solver: Any = GaussNewton()
    shape = eqx.filter_eval_shape(residuals, at)
    state = solver.init(function, at, None, {}, shape, None, frozenset())
    return solver.step(function, at, None, {}, state, frozenset())[1].y_eval
