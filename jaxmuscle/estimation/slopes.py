"""Residuals of a recording and their derivatives for many sets of parameters at once, by forward mode."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.names import OFFSET, START, of_machine
from jaxmuscle.fitting.predictions import link_predictions
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.parameters import replace


def moved(
    actuator: AbstractActuator, problem: Problem, paths: Sequence[str], values: Sequence[Array]
) -> tuple[AbstractActuator, Problem]:
    """The machine and the problem with the given values (SI) at the paths.

    The offset of a sensor is taken off what it measured, which is both the target and the measured state
    from which windows begin or which is imposed. A state at the first sample takes the place of what was
    measured there, or of rest.
    """
    given = dict(zip(paths, values, strict=True))
    machine = replace(actuator, {path: v for path, v in given.items() if of_machine(path)})
    offsets = {path.removeprefix(OFFSET): v for path, v in given.items() if path.startswith(OFFSET)}
    begin = {path.removeprefix(START): v for path, v in given.items() if path.startswith(START)}
    if begin:
        problem = dataclasses.replace(problem, begin={**problem.begin, **begin})
    if not offsets:
        return machine, problem
    measured, targets = dict(problem.track.measured), dict(problem.targets)
    for state, columns in actuator.measured.items():
        measured[state] = measured[state] - _stacked(columns, offsets)
    for output, columns in actuator.outputs.items():
        targets[output] = targets[output] - _stacked(columns, offsets)
    return machine, eqx.tree_at(lambda p: (p.track.measured, p.targets), problem, (measured, targets))


def residual_vector(
    theta: Float[Array, " values"],
    actuator: AbstractActuator,
    problem: Problem,
    paths: Sequence[str],
    substeps: int | Array | None = None,
) -> Float[Array, " residuals"]:
    """Weighted residuals of all links, one after the other; what is not a number is left as it is.

    Args:
        substeps: solver steps between two samples; the problem's when `None`.
    """
    machine, shifted = moved(actuator, problem, paths, [theta[i] for i in range(len(paths))])
    predicted = link_predictions(machine, shifted, substeps)

    def weighted(output: str) -> Array:
        weight = shifted.weights[output]
        return jnp.where(weight > 0, (predicted[output] - shifted.targets[output]) * weight, 0.0).ravel()

    return jnp.concatenate([weighted(link.output) for link in actuator.links])


@eqx.filter_jit
def values_and_slopes(
    thetas: Float[Array, "lanes values"], actuator: AbstractActuator, problem: Problem, paths: tuple[str, ...]
) -> tuple[Float[Array, "lanes residuals"], Float[Array, "lanes values residuals"]]:
    """Residuals at each set of values (SI) and their derivatives by every value.

    All sets and all tangents go through one simulation, compiled once for a structure of the machine and a
    shape of the problem.
    """

    def lane(theta: Array) -> tuple[Array, Array]:
        def pushed(direction: Array) -> tuple[Array, Array]:
            run = lambda t: residual_vector(t, actuator, problem, paths)  # noqa: E731
            return jax.jvp(run, (theta,), (direction,))

        return jax.vmap(pushed, out_axes=(None, 0))(jnp.eye(len(paths)))

    if len(thetas) == 1:  # one level of batching less is traced and compiled in two thirds of the time
        return tuple(part[None] for part in lane(thetas[0]))  # pyright: ignore[reportReturnType]
    return jax.vmap(lane)(thetas)


def _stacked(columns: Sequence[str], offsets: dict[str, Array]) -> Array:
    values = [offsets.get(column, jnp.zeros(())) for column in columns]
    return values[0] if len(values) == 1 else jnp.stack(values, axis=-1)
