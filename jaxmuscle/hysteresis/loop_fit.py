"""Least-squares fit of hysteresis models and other algebraic ones: every number of a module is free."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.operators import AbstractHysteresis, respond
from jaxmuscle.optimization.descents import LONGEST_STEP
from jaxmuscle.optimization.least_squares import least_squares, with_jacobian
from jaxmuscle.parameters import get, parameters, replace

Model = TypeVar("Model", bound=eqx.Module)
Hysteresis = TypeVar("Hysteresis", bound=AbstractHysteresis)

Series = ArrayLike | Sequence[float]


@dataclasses.dataclass(frozen=True)
class LoopFit(Generic[Model]):
    """Where a fit ended: the model, its outputs, root mean square of what is left, whether it converged."""

    model: Model
    outputs: Float[Array, " samples"]
    rmse: float
    converged: bool


RESTARTS, FALL = 10, 1e-4
"""Times that a fit goes on from its end with a new radius, as kinks shrink it; fall of cost that ends it."""


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
    return min(ends, key=lambda end: end.rmse if np.isfinite(end.rmse) else np.inf)


def _solved(
    start: Model, free: tuple[str, ...], residuals: Callable[[Model, Any], Array], data: Any
) -> LoopFit[Model]:
    """The best end from one start."""
    values = [np.asarray(get(start, path)) for path in free]
    # Of what is zero at the start nobody knows how large it is.
    longest = np.repeat([LONGEST_STEP if x.any() else np.inf for x in values], [x.size for x in values])
    function = with_jacobian(_moved_residuals, (start, free, residuals, data))
    found = least_squares(function, np.zeros(len(longest)), longest=longest)
    for _ in range(RESTARTS):
        again = least_squares(function, found.x, longest=longest)
        settled, found = again.cost > (1 - FALL) * found.cost, again
        if settled:
            break
    left = jnp.asarray(function(found.x)[0])
    rmse = float(np.sqrt(2 * found.cost / found.residuals))
    return LoopFit(_moved(start, free, jnp.asarray(found.x)), left, rmse, found.converged)


def _moved_residuals(
    z: Float[Array, " k"], task: tuple[Model, tuple[str, ...], Callable[[Model, Any], Array], Any]
) -> Array:
    start, free, residuals, data = task
    return residuals(_moved(start, free, z), data)


def _moved(start: Model, free: tuple[str, ...], z: Float[Array, " k"]) -> Model:
    """The model with the parameters at coordinates that are 0 at its start."""
    values, begin = {}, 0
    for path in free:
        first = jnp.asarray(get(start, path))
        part = z[begin : begin + first.size].reshape(first.shape)
        values[path] = _value(first, part, parameters(start)[path].positive)
        begin += first.size
    return replace(start, values)


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
