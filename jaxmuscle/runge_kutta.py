"""The usual explicit Runge-Kutta methods for diffrax, their stages written out.

diffrax keeps the stages of its own methods in an array and loops over them, which refuses forward mode and,
in a batch of short runs, takes five times as long as the arithmetic. The coefficients are diffrax's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
from diffrax import RESULTS
from equinox.internal import ω


class RungeKutta(diffrax.AbstractSolver):
    r"""One step: :math:`k_i = f(t + c_i h, y + h \sum_j a_{ij} k_j),\ y_1 = y + h \sum_i b_i k_i`.

    The error is :math:`h \sum_i (b_i - \hat b_i) k_i` with the weights of the embedded method.

    Attributes:
        name: of a diffrax method: "Heun", "Bosh3", "Dopri5".
    """

    name: str = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., Any]] = diffrax.LocalLinearInterpolation

    def order(self, terms: object) -> int:
        """Order of the method."""
        return getattr(diffrax, self.name)().order(terms)

    def init(self, terms, t0, t1, y0, args) -> None:
        """Nothing is carried from step to step."""

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step from `t0` to `t1`, with the estimate of its error."""
        del solver_state, made_jump
        table = getattr(diffrax, self.name).tableau
        width = t1 - t0
        rates = [terms.vf(t0, y0, args)]
        for row, node in zip(table.a_lower, table.c, strict=True):
            at = (y0**ω + width * _sum(row, rates)).ω
            rates.append(terms.vf(t0 + float(node) * width, at, args))
        y1 = (y0**ω + width * _sum(table.b_sol, rates)).ω
        error = (width * _sum(table.b_error, rates)).ω
        return y1, error, {"y0": y0, "y1": y1}, None, RESULTS.successful

    def func(self, terms, t0, y0, args) -> Any:
        """The vector field."""
        return terms.vf(t0, y0, args)


def _sum(weights: Any, rates: list[Any]) -> Any:
    """Weighted sum of trees, without the terms of weight zero."""
    pairs = zip(weights, rates, strict=True)
    return sum(float(weight) * rate**ω for weight, rate in pairs if weight != 0)
