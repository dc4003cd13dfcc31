"""An exponential Runge-Kutta method for diffrax: a fast linear part of a machine is integrated exactly.

A lightly damped resonance binds an explicit method to steps far shorter than anything that is sampled, and
Chebyshev's lie along the wrong axis. Where the fast part is linear with constant coefficients,
y' = A y + N(t, y), the second-order method ETD2RK of Cox and Matthews (J. Comput. Phys. 176, 2002,
equations 20 to 22) needs the exponential of A once a run and two evaluations a step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
from diffrax import RESULTS
from jax.flatten_util import ravel_pytree

from jaxmuscle.propagator import Propagator


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
