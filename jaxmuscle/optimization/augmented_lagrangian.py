"""Nonlinear least squares under inequalities, by the augmented Lagrangian."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.optimization.least_squares import LeastSquares, least_squares

Vector = NDArray[np.float64]

PENALTY, GROWTH, FALL = 1.0, 10.0, 0.25
"""Penalty to begin with; its growth from a round to the next where the excess did not fall to this share."""
TIGHTER = 1e-12
"""Relative fall of the cost at which the minimum of a round is one."""


class Bounded(NamedTuple):
    """Residuals r and excesses g at a point, with Jacobians; where g is above zero a limit is broken."""

    residuals: Float[np.ndarray, " n"]
    slopes: Float[np.ndarray, "n k"]
    excess: Float[np.ndarray, " m"]
    excess_slopes: Float[np.ndarray, "m k"]


@dataclasses.dataclass(frozen=True)
class ConstrainedMinimum:
    """The minimum under limits that was found.

    Attributes:
        x: coordinates.
        cost: half the sum of squares of the residuals.
        multipliers: fall of the cost per excess that a limit would let through; zero where it is not reached.
        excess: the largest, at most the tolerance where `kept`.
        kept: whether all limits are kept, and reached wherever their multipliers are not zero.
        converged: kept, at a minimum.
        evaluations: of residuals and Jacobians; rounds: of multipliers.
    """

    x: Vector
    cost: float
    multipliers: Float[np.ndarray, " m"]
    excess: float
    kept: bool
    converged: bool
    evaluations: int
    rounds: int


def constrained_least_squares(
    function: Callable[[Vector], Bounded],
    start: Vector,
    *,
    lower: Vector | float = -np.inf,
    upper: Vector | float = np.inf,
    tolerance: float = 1e-3,
    rounds: int = 20,
    steps: int = 100,
) -> ConstrainedMinimum:
    r"""Minimise half a sum of squares where no excess is above zero.

    .. math:: \min_x \frac12 |r(x)|^2 \quad\text{where}\quad g(x) \le 0

    In every round the augmented Lagrangian :math:`\frac12 |r|^2 + \frac{\mu}{2} \sum_j \max(0, g_j +
    \lambda_j/\mu)^2`, again a sum of squares, is minimised by Levenberg-Marquardt; then :math:`\lambda_j`
    becomes :math:`\max(0, \lambda_j + \mu g_j)` (Rockafellar, Math. Programming 5, 1973; Nocedal and Wright,
    Numerical Optimization, 2nd ed. 2006, section 17.3). An equality is two inequalities.

    Args:
        function: at a point (k,); write g in units in which an excess of one is as bad as a residual of one.
        lower, upper: of the coordinates.
        tolerance: excess that counts as none, and how far from its limit one with a multiplier may end.
        rounds, steps: of multipliers, and of Levenberg-Marquardt in each, at most.

    Raises:
        InputError: a tolerance or a number that is not above zero; at the start something is not a number.
    """
    for name, value in {"tolerance": tolerance, "rounds": rounds, "steps": steps}.items():
        if not value > 0:
            raise InputError(f"{name}: expected a number above zero; got {value!r}")
    x, penalty, before, count = np.asarray(start, dtype=float), PENALTY, np.inf, 0
    multipliers, done, found, found_at = np.zeros(len(function(x).excess)), 0, None, None
    for done in range(1, rounds + 1):
        lagrangian = _augmented(function, multipliers, penalty)
        found = least_squares(lagrangian, x[None], lower=lower, upper=upper, tolerance=TIGHTER, steps=steps)
        x, count, found_at = found.x, count + found.evaluations, function(found.x)
        # How far limits are broken, or not reached though their multipliers say so.
        left = float(np.abs(np.maximum(found_at.excess, -multipliers / penalty)).max(initial=0.0))
        multipliers = np.maximum(0.0, multipliers + penalty * found_at.excess)
        if left <= tolerance:
            return _ended(found, found_at, multipliers, True, count, done)
        if left > FALL * before:
            penalty *= GROWTH
        before = left
    assert found is not None and found_at is not None
    return _ended(found, found_at, multipliers, False, count, done)


def _augmented(
    function: Callable[[Vector], Bounded], multipliers: Vector, penalty: float
) -> Callable[[Vector], tuple[Vector, Float[np.ndarray, "n k"]]]:
    """Residuals of the augmented Lagrangian and their Jacobian."""
    root = np.sqrt(penalty)

    def residuals(x: Vector) -> tuple[Vector, Float[np.ndarray, "n k"]]:
        at = function(x)
        shifted = at.excess + multipliers / penalty
        over = np.where(np.isnan(shifted), np.nan, np.maximum(shifted, 0.0))
        slopes = np.where((shifted > 0)[:, None], at.excess_slopes, 0.0)
        return np.append(at.residuals, root * over), np.vstack([at.slopes, root * slopes])

    return residuals


def _ended(
    found: LeastSquares, at: Bounded, multipliers: Vector, kept: bool, count: int, rounds: int
) -> ConstrainedMinimum:
    return ConstrainedMinimum(
        found.x,
        0.5 * float(at.residuals @ at.residuals),
        multipliers,
        float(at.excess.max(initial=0.0)),
        kept,
        kept and found.converged,
        count,
        rounds,
    )
