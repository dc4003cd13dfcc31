"""Solvers of optimistix in place of the trust region of our own.

A descent evaluates cost, gradient and Gauss-Newton matrix of all starts in one compiled program; a solver of
optimistix takes its step from them. So nothing of a simulation is traced or compiled for it, and starts,
deadline, progress and failures are those of `descent`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.optimization.descents import CONVERGED, STALLED, STEPS, Lane, Limits, Local, scale
from jaxmuscle.optimization.levenberg_marquardt import ROUNDING, Quadratic

Vector = NDArray[np.float64]

WITHOUT_PROGRESS = 15
"""Evaluations in a row, none lower than the best before, after which a run ends."""
RESTARTS = 10
"""Times at most that coordinates leave the bounds to which a solver took them."""
FAR = 1e3
"""Size of the residual, relative to the best so far, at a point where there is none."""


def steps_by(solver: object) -> Callable[[Lane, Local, Limits], None]:
    """The steps of a solver, as `Limits.solver` takes them.

    Args:
        solver: such as ``optimistix.LevenbergMarquardt(rtol=1e-3, atol=1e-3)``, or a minimiser such as
            ``optimistix.BFGS``. Its tolerances are of coordinates in standard deviations, as the curvature
            at the start gives them, and of residuals in units of the noise.

    Raises:
        InputError: not a solver of optimistix for least squares or minimisation, or one that takes no
            derivatives.
    """
    if not isinstance(solver, optx.AbstractLeastSquaresSolver | optx.AbstractMinimiser):
        raise InputError(
            f"solver: expected a solver of optimistix, such as "
            f"optimistix.LevenbergMarquardt(rtol=1e-3, atol=1e-3), or None for our own; got {solver!r}"
        )
    useless = InputError(
        f"solver: {type(solver).__name__} does not step by derivatives of several coordinates; take "
        f"optimistix.LevenbergMarquardt, Dogleg, GaussNewton or BFGS, or None for our own"
    )
    try:
        state = eqx.filter_eval_shape(_begun, solver, jnp.zeros(2))
    except (KeyError, TypeError, ValueError) as error:  # as golden section does of more than a scalar
        raise useless from error
    if _trial(state) is None:
        raise useless
    return _Steps(solver)


@dataclasses.dataclass
class _Run:
    """A solver on its way from a point u.

    Attributes:
        u, unit: of the coordinates y = (u' - u) unit, in which the Gauss-Newton matrix has ones on its
            diagonal at u: standard deviations, where residuals are in units of the noise.
        y, state: of the solver, without what is not an array.
        asked: the y that it wants to be evaluated next.
        fixed: coordinates at a bound at the point that was evaluated last.
        restarts: runs before this one.
    """

    u: Vector
    unit: Vector
    y: Array
    state: Any
    asked: Vector
    fixed: Bool[np.ndarray, " k"]
    restarts: int = 0

    @property
    def trial(self) -> Vector:
        """Where the solver wants to be evaluated, be it beyond a bound."""
        return self.u + self.asked / self.unit


class _Steps:
    """Takes the outcome of a trial into a lane by one step of the solver.

    A solver knows no bounds. Points beyond are evaluated on them, where the residuals do not depend on the
    coordinate any more. When the solver has ended, coordinates at a bound that the gradient pushes inwards
    are free again, and it goes on from there: where it ends for good no bound holds up a descent.
    """

    def __init__(self, solver: Any) -> None:
        self.solver = solver

    def __call__(self, lane: Lane, local: Local, limits: Limits) -> None:
        if lane.local is None:
            if not lane.begin(local, limits):
                return
            lane.memory = self._run(lane, 0)
        else:
            lane.steps += 1
            lane.rejected += 1
            if local.finite and local.cost < lane.cost:
                assert lane.trial is not None
                lane.u, lane.local, lane.rejected = lane.trial, local, 0
        lane.costs.append(lane.cost)
        ended = self._step(lane, local, limits)
        if not ended and lane.rejected >= WITHOUT_PROGRESS:
            ended = STALLED
        if ended == CONVERGED and self._held_up(lane, limits):
            assert lane.local is not None
            lane.memory = self._run(lane, lane.memory.restarts + 1)
            ended = self._step(lane, lane.local, limits)
        if not ended and lane.steps >= limits.steps:
            ended = STEPS
        if ended:
            lane.end(ended)
        else:
            lane.trial = np.clip(lane.memory.trial, limits.lower, limits.upper)

    def _run(self, lane: Lane, restarts: int) -> _Run:
        """A new run of the solver from the best point."""
        assert lane.local is not None
        size = np.sqrt(lane.local.matrix.diagonal())
        start = np.zeros(len(lane.u))
        y = jnp.asarray(start)
        fixed = np.zeros(len(lane.u), dtype=bool)
        return _Run(lane.u, np.where(size > 0, size, 1.0), y, _begin(self.solver, y), start, fixed, restarts)

    def _step(self, lane: Lane, local: Local, limits: Limits) -> str:
        """Let the solver have what was evaluated; how it ended, or nothing."""
        run: _Run = lane.memory
        run.fixed = _fixed(run.trial, local, limits)
        if local.finite:
            residual, jacobian = _root(local, run.fixed | lane.held, run.unit)
        else:
            residual, jacobian = np.zeros(len(lane.u) + 1), np.eye(len(lane.u) + 1, len(lane.u))
            residual[-1] = FAR * np.sqrt(2 * lane.cost)
        given = jnp.asarray(run.asked), jnp.asarray(residual), jnp.asarray(jacobian)
        run.y, run.state, asked, ended, sound = _stepped(self.solver, run.y, run.state, given)
        run.asked = np.asarray(asked)
        if not sound or not np.isfinite(run.asked).all():
            return STALLED
        if not ended:
            return ""
        # One that takes every step may rest where it is worse than before, all coordinates beyond bounds.
        worse = local.cost - lane.cost > limits.tolerances.near * scale(lane, limits)
        return STALLED if worse or not local.finite else CONVERGED

    def _held_up(self, lane: Lane, limits: Limits) -> bool:
        """Whether the cost would fall from the best point if coordinates left their bounds."""
        local, run = lane.local, lane.memory
        assert local is not None
        at_bound = (lane.u <= limits.lower) | (lane.u >= limits.upper)
        inward = run.fixed & at_bound & ~_fixed(lane.u, local, limits) & ~lane.held
        if not inward.any() or run.restarts >= RESTARTS:
            return False
        inner = Quadratic(local.matrix[inward][:, inward], local.gradient[inward], run.unit[inward])
        return inner.fall > limits.tolerances.near * scale(lane, limits)


def _fixed(u: Vector, local: Local, limits: Limits) -> Bool[np.ndarray, " k"]:
    """Coordinates on which the residuals at u do not depend: none, or beyond a bound, or pushed on one."""
    below = (u < limits.lower) | ((u == limits.lower) & (local.gradient > 0))
    above = (u > limits.upper) | ((u == limits.upper) & (local.gradient < 0))
    return below | above | ~(local.matrix.diagonal() > 0)


def _root(
    local: Local, fixed: Bool[np.ndarray, " k"], unit: Vector
) -> tuple[Float[np.ndarray, " k+1"], Float[np.ndarray, "k+1 k"]]:
    r"""As few residuals as have the cost, gradient and Gauss-Newton matrix: k + 1.

    With the symmetric root S of the matrix H they are :math:`S^{-1} g` and what is left of the cost, which is
    :math:`c - \frac12 g^T H^{-1} g \ge 0` for squares, Huber's loss and Student's. They change with the
    point as steadily as g and H do. A fixed coordinate has a one in H and no gradient: a solver leaves it
    where it is.
    """
    free = ~fixed
    matrix = np.where(np.outer(free, free), local.matrix / np.outer(unit, unit), np.diag(fixed.astype(float)))
    values, axes = np.linalg.eigh(matrix)
    roots = np.sqrt(np.maximum(values, ROUNDING * values[-1]))
    along = axes @ ((axes.T @ np.where(free, local.gradient / unit, 0.0)) / roots)
    left = np.sqrt(max(2 * local.cost - along @ along, 0.0))
    return np.append(along, left), np.vstack([(axes * roots) @ axes.T, np.zeros(len(unit))])


def _trial(state: Any) -> Any:
    """Where a solver wants the function to be evaluated, within the state of one that wraps another."""
    while not hasattr(state, "y_eval") and hasattr(state, "state"):
        state = state.state
    return getattr(state, "y_eval", None)


def _function(solver: Any) -> Callable[[Array, Any], tuple[Array, None]]:
    """Residuals r + J (y - point), or half the sum of their squares: what a solver sees, at that point."""

    def residuals(y: Array, given: tuple[Array, Array, Array]) -> tuple[Array, None]:
        point, residual, jacobian = given
        return residual + jacobian @ (y - point), None

    def cost(y: Array, given: tuple[Array, Array, Array]) -> tuple[Array, None]:
        return 0.5 * (residuals(y, given)[0] ** 2).sum(), None

    return cost if isinstance(solver, optx.AbstractMinimiser) else residuals


def _begun(solver: Any, y: Array) -> Any:
    """The state of a solver before its first step."""
    size = len(y)
    given = y, jnp.zeros(size + 1), jnp.zeros((size + 1, size))
    function = _function(solver)
    shape, aux = eqx.filter_eval_shape(function, y, given)
    return solver.init(function, y, given, {}, shape, aux, frozenset())


@eqx.filter_jit
def _begin(solver: Any, y: Array) -> Any:
    return eqx.filter(_begun(solver, y), eqx.is_array)


@eqx.filter_jit
def _stepped(
    solver: Any, y: Array, moving: Any, given: tuple[Array, Array, Array]
) -> tuple[Array, Any, Array, Array, Array]:
    """One step: y, state, the point that is asked for next, whether the solver has ended, and well."""
    before = eqx.combine(moving, eqx.filter(_begun(solver, y), eqx.is_array, inverse=True))
    function = _function(solver)
    y, after, _ = solver.step(function, y, given, {}, before, frozenset())
    ended, result = solver.terminate(function, y, given, {}, after, frozenset())
    return y, eqx.filter(after, eqx.is_array), _trial(after), ended, result == optx.RESULTS.successful


def bfgs(tolerance: float) -> Callable[[Lane, Local, Limits], None]:
    """The steps of BFGS, for a cost of which gradients are known and no curvature.

    `tolerance`: of coordinates, scaled by the slope at the start, and of the cost, relative and absolute.
    """
    return steps_by(optx.BFGS(rtol=tolerance, atol=tolerance))
