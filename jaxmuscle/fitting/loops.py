"""Levenberg-Marquardt for models of hysteresis and other algebraic ones: every number of a module is free."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.base import AbstractHysteresis, respond
from jaxmuscle.parameters import get, parameters, replace

Model = TypeVar("Model", bound=eqx.Module)
Hysteresis = TypeVar("Hysteresis", bound=AbstractHysteresis)

Series = ArrayLike | Sequence[float]

TOLERANCE = 1e-9
STEPS = 300


@dataclasses.dataclass(frozen=True)
class LoopFit(Generic[Model]):
    """Where a fit ended: the model, its outputs, root mean square of what is left, whether it converged."""

    model: Model
    outputs: Float[Array, " samples"]
    rmse: float
    converged: bool


def largest_relative_error(outputs: Series, measured: Series) -> float:
    """Largest error relative to the range of what was measured: the measure of [W], section 2.2."""
    true = np.asarray(measured)
    return float(np.abs(np.asarray(outputs) - true).max() / np.ptp(true))


def fit_loop(
    starts: Hysteresis | Sequence[Hysteresis],
    values: Series,
    measured: Series,
    *,
    judged: slice = slice(None),
    held: Sequence[str] = (),
) -> LoopFit[Hysteresis]:
    """Fit a model of hysteresis to a measured loop.

    Args:
        starts: models from which to start, alike in structure; the best end is returned.
        values: the input from the unused device on, shape (samples,).
        measured: the output at every sample.
        judged: the samples that count; the first way of a device of unknown history should not.
        held: dotted paths of parameters that stay as they are.

    Raises:
        InputError: series of different lengths, values that are not finite, nothing left to fit.
    """
    inputs, target = _checked(values, measured)

    counts = jnp.zeros(len(inputs)).at[judged].set(1.0)
    models = starts if isinstance(starts, Sequence) else [starts]
    found = best_fit(models, _loop_residuals, (inputs, target, counts), held)
    outputs = target + _loop_residuals(found.model, (inputs, target, jnp.ones(len(inputs))))
    rmse = float(jnp.sqrt(jnp.sum(found.outputs**2) / counts.sum()))
    return dataclasses.replace(found, outputs=outputs, rmse=rmse)


def _loop_residuals(model: AbstractHysteresis, data: tuple[Array, Array, Array]) -> Array:
    inputs, target, counts = data
    return counts * (respond(model, inputs)[1] - target)


def best_fit(
    starts: Sequence[Model], residuals: Callable[[Model, Any], Array], data: Any, held: Sequence[str] = ()
) -> LoopFit[Model]:
    """Least squares over all parameters of a module from several starts, the best end.

    Positive parameters are fitted by their logarithm, the others in units of their size at the start (of
    the largest entry, for an array; 1 for zero). `outputs` of the result holds the residuals.

    Args:
        residuals: of a model and `data`, as one vector; the same function again is not compiled again.
    """
    free = [path for path in parameters(starts[0]) if path not in held]
    if unknown := set(held) - set(parameters(starts[0])):
        raise InputError(f"no parameters {sorted(unknown)} to hold; there are {list(parameters(starts[0]))}")
    if not free:
        raise InputError("all parameters are held: there is nothing to fit")
    ends = [_solved(start, tuple(free), residuals, data) for start in starts]
    costs = [float(jnp.sum(left**2)) for _, left, _ in ends]
    best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
    model, left, converged = ends[best]
    return LoopFit(model, left, float(np.sqrt(np.mean(np.asarray(left) ** 2))), bool(converged))


@eqx.filter_jit
def _solved(
    start: Model, free: tuple[str, ...], residuals: Callable[[Model, Any], Array], data: Any
) -> tuple[Model, Array, Array]:
    """The fitted model, its residuals, and whether the solver says it has converged."""
    first = {path: get(start, path) for path in free}
    positive = {path: parameters(start)[path].positive for path in free}

    def moved(z: dict[str, Array]) -> Model:
        return replace(start, {path: _value(first[path], z[path], positive[path]) for path in free})

    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    solution = optx.least_squares(
        lambda z, data: residuals(moved(z), data),
        solver,
        jax.tree.map(jnp.zeros_like, first),
        data,
        options={"jac": "fwd"},
        max_steps=STEPS,
        throw=False,
    )
    model = moved(solution.value)
    return model, residuals(model, data), solution.result == optx.RESULTS.successful


def _value(first: Array, z: Array, positive: bool) -> Array:
    """A parameter at a coordinate that is 0 at its start."""
    if positive:
        return first * jnp.exp(z)
    largest = jnp.max(jnp.abs(first))
    return first + jnp.where(largest == 0, 1.0, largest) * z


def _checked(values: Series, measured: Series) -> tuple[Array, Array]:
    inputs, target = (jnp.asarray(np.asarray(series), dtype=float) for series in (values, measured))
    if inputs.shape != target.shape or inputs.ndim != 1 or not inputs.size:
        raise InputError(
            "expected inputs and outputs as two series of one length; "
            f"got shapes {inputs.shape} and {target.shape}"
        )
    if not bool(jnp.isfinite(inputs).all() & jnp.isfinite(target).all()):
        raise InputError("inputs and outputs have to be finite; remove the samples that are not")
    return inputs, target
