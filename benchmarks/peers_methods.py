"""The package's methods for CasADi: one fixed step on a matrix whose first column is the state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jaxmuscle.simulation.solvers import STAGES, stages_of

TABLES = {
    "heun": (((1.0,),), (1 / 2, 1 / 2)),
    "bogacki-shampine": (((1 / 2,), (0.0, 3 / 4)), (2 / 9, 1 / 3, 4 / 9)),
}
"""Stages and weights of Runge-Kutta methods."""


def onward(method: str, rate: Callable[[Any, float], Any], y: Any, h: float) -> Any:
    """One step of a method.

    Args:
        rate: (y, fraction of the step) → its rate; further columns of `y` are sensitivities.
    """
    if method == "chebyshev":
        first = rate(y, 0.0)
        before = last = 0 * y
        node = 0.0
        for stage in stages_of(STAGES):
            now = rate(y + last, node) if node else first
            slope = stage.rate * now + stage.first_rate * first
            before, last = last, stage.last * last + stage.before * before + h * slope
            node = stage.node
        return y + last
    rows, weights = TABLES[method]
    found = [rate(y, 0.0)]
    for row in rows:
        found.append(rate(y + h * sum(a * k for a, k in zip(row, found, strict=True)), sum(row)))
    return y + h * sum(b * k for b, k in zip(weights, found, strict=True))
