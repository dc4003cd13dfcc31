"""Nonlinear least squares of a plain residual function."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.optimization.descents import CONVERGED, LONGEST_STEP, Lane, Limits, Local, Tolerances, best
from jaxmuscle.optimization.levenberg_marquardt import descend

Vector = NDArray[np.float64]
Residuals = Float[np.ndarray, " n"]
Jacobian = Float[np.ndarray, "n k"]

TOLERANCE = 1e-8
"""Relative fall of the cost that the quadratic model expects at most at a minimum."""
NOTICEABLE = 1e-7
"""Relative fall of the cost that eight steps have to bring: along a narrow bent valley it is little."""
EXACT = 1e-20
"""Cost, relative to that at the first start, below which a fit is exact: residuals fell to 1e-10."""
SINGULAR = 1e-13
"""Eigenvalue of the scaled matrix JᵀJ, relative to the largest, below which nothing is known."""


@dataclasses.dataclass(frozen=True)
class LeastSquares:
    """The lowest minimum that was found.

    Attributes:
        x: coordinates.
        cost: half the sum of squares.
        matrix: JᵀJ at x.
        code: how the descent to x ended, "converged" at a minimum.
        residuals: their number.
        at_bound: coordinates that ended at a bound.
        evaluations: of residuals and Jacobian, from all starts.
    """

    x: Vector
    cost: float
    matrix: Float[np.ndarray, "k k"]
    code: str
    residuals: int
    at_bound: Bool[np.ndarray, " k"]
    evaluations: int

    @property
    def converged(self) -> bool:
        """Whether it is a minimum."""
        return self.code == CONVERGED

    @property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        r"""Covariance of x under white residuals, :math:`s^2 (J^T J)^+` with :math:`s^2 = \sum r^2/(n - k)`.

        Coordinates at a bound count as known: they have no variance and are not among the k.
        """
        free = np.flatnonzero(~self.at_bound)
        inner, found = self.matrix[free[:, None], free], np.zeros_like(self.matrix)
        size = np.sqrt(np.where(np.diag(inner) > 0, np.diag(inner), 1.0))
        inverse = np.linalg.pinv(inner / np.outer(size, size), rcond=SINGULAR, hermitian=True)
        variance = 2 * self.cost / max(self.residuals - len(free), 1)
        found[free[:, None], free] = variance * inverse / np.outer(size, size)
        return found


def least_squares(
    function: Callable[[Vector], tuple[Residuals, Jacobian]],
    starts: Float[np.ndarray, "starts k"],
    *,
    lower: Vector | float = -np.inf,
    upper: Vector | float = np.inf,
    longest: Vector | float = np.inf,
    tolerance: float = TOLERANCE,
    steps: int = 300,
    solver: Callable[[Lane, Local, Limits], None] | None = None,
) -> LeastSquares:
    """Minimise half a sum of squares within bounds by Levenberg-Marquardt, from each of several starts.

    The minimiser is :func:`jaxmuscle.optimization.levenberg_marquardt.descend`; a point where a residual is
    not a number is stepped back from.

    Args:
        function: residuals (n,) at a point (k,) and their Jacobian (n, k); :func:`with_jacobian` makes it.
        lower, upper: of the coordinates; starts beyond them are moved to them.
        longest: change of a coordinate in one step at most, 1.5 of a logarithm for instance.
        tolerance: expected fall of the cost, relative to it, at which a minimum is reached.
        steps: of a start at most.
        solver: in place of our own trust region; see `Limits.solver`.

    Raises:
        InputError: at every start some residual or derivative is not a number.
    """
    points = np.atleast_2d(np.asarray(starts, dtype=float))
    below, above = (np.broadcast_to(np.asarray(x, dtype=float), points[0].shape) for x in (lower, upper))
    points = np.clip(points, below, above)
    evaluate = _Evaluated(function, points[0])
    limits = Limits(
        below,
        above,
        steps,
        len(points),
        samples=2,  # so that the scale in which falls are judged is the cost itself
        reach=np.broadcast_to(longest, points[0].shape) / LONGEST_STEP,
        tolerances=Tolerances(tolerance, NOTICEABLE, exact=EXACT / tolerance * evaluate.first.cost),
        solver=solver,
    )
    lowest = best(descend(evaluate, points, limits))
    if lowest is None or lowest.local is None:
        raise InputError(
            f"at none of {len(points)} starts are all residuals and their derivatives numbers; "
            "start elsewhere"
        )
    at_bound = (lowest.u <= below) | (lowest.u >= above)
    return LeastSquares(
        lowest.u,
        lowest.cost,
        lowest.local.matrix,
        lowest.code,
        evaluate.residuals,
        at_bound,
        evaluate.count,
    )


class _Evaluated:
    """What a descent asks of a function, counted; the first start is evaluated only once."""

    def __init__(self, function: Callable[[Vector], tuple[Residuals, Jacobian]], start: Vector) -> None:
        self._function, self._start = function, start
        self.count, self.residuals = 0, 0
        self.first = self._at(start)

    def __call__(self, points: Float[np.ndarray, "lanes k"]) -> list[Local]:
        return [self.first if np.array_equal(x, self._start) else self._at(x) for x in points]

    def _at(self, x: Vector) -> Local:
        r, jacobian = self._function(x)
        self.count, self.residuals = self.count + 1, len(r)
        # Far from anything sensible a square may be infinite: the step is then taken back.
        with np.errstate(over="ignore", invalid="ignore"):
            return Local(0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian, 0)


def with_jacobian(
    residuals: Callable[[Array, Any], Array], data: Any
) -> Callable[[Vector], tuple[Residuals, Jacobian]]:
    """The function that :func:`least_squares` asks for, of a residual function written in JAX.

    Args:
        residuals: of a point (k,) and `data`, as one vector (n,). The same function with data of the same
            structure and shapes is not compiled again.
    """

    def function(x: Vector) -> tuple[Residuals, Jacobian]:
        r, jacobian = _value_and_jacobian(residuals, jnp.asarray(x), data)
        return np.asarray(r), np.asarray(jacobian)

    return function


@eqx.filter_jit
def _value_and_jacobian(residuals: Callable[[Array, Any], Array], x: Array, data: Any) -> tuple[Array, Array]:
    """Residuals and their Jacobian from one forward pass with a tangent for every coordinate."""

    def pushed(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda point: residuals(point, data), (x,), (tangent,))

    return jax.vmap(pushed, out_axes=(None, 1))(jnp.eye(len(x)))
