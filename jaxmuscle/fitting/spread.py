"""Variance that uncertain measured states put on what is predicted from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.fitting.residuals import evaluate

Line = NDArray[np.float64]


def expected_spread(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that the uncertainty of the smoothed states puts on the predictions of the links.

    Each rate of a measured state, the least certain of what is smoothed, is shifted by ± its standard
    deviation and, because channels are read one after the other and the instant at which a motion turns is
    not known better, by ± one sample: both where it starts a window and where it is imposed. Half the
    difference of the predictions, squared, is summed. Zero where nothing counts.
    """
    pairs = {}
    for name in actuator.derivatives:
        values, size = np.asarray(problem.track.measured[name]), np.asarray(spread[name])
        pairs[name] = ((values + size, values - size), _neighbours(values, problem))
    return spread_between(actuator, problem, pairs)


def spread_between(
    actuator: AbstractActuator, problem: Problem, pairs: Mapping[str, Iterable[tuple[Line, Line]]]
) -> Residuals:
    """Half the difference of the predictions under two values of a measured state, squared and summed.

    Zero where nothing counts.

    Args:
        pairs: name of a measured state → pairs of values along the recording, of which each adds a term.
    """

    def predicted(name: str, values: Line) -> dict[str, Line]:
        measured = {**problem.track.measured, name: jnp.asarray(values)}
        found = evaluate(actuator, eqx.tree_at(lambda p: p.track.measured, problem, measured))
        return {out: np.asarray(each) for out, each in found.items()}

    total = {out: np.zeros(target.shape) for out, target in problem.targets.items()}
    for name, both in pairs.items():
        for one, other in both:
            up, down = predicted(name, one), predicted(name, other)
            total = {out: total[out] + (0.5 * (up[out] - down[out])) ** 2 for out in total}
    found = {}
    for out, weights in problem.weights.items():
        w = np.asarray(weights)
        with np.errstate(over="ignore"):
            found[out] = jnp.asarray(np.where(w > 0, total[out] / np.where(w > 0, w, 1.0) ** 2, 0.0))
    return found


def _neighbours(values: Line, problem: Problem) -> tuple[Line, Line]:
    """The value a sample before and a sample later; its own where that sample is none that counts.

    A held-out sample next to the windows must not reach even their weights.
    """
    rows = problem.sample_rows
    counts = np.zeros(len(values), dtype=bool)
    for weights in problem.weights.values():
        counts[rows[(np.asarray(weights) > 0).reshape(*rows.shape, -1).any(-1)]] = True
    along = (-1, *[1] * (values.ndim - 1))
    before, after = np.roll(counts, 1), np.roll(counts, -1)
    before[0] = after[-1] = False
    late = np.where(before.reshape(along), np.roll(values, 1, axis=0), values)
    return late, np.where(after.reshape(along), np.roll(values, -1, axis=0), values)
