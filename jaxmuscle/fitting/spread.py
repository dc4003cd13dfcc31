"""Variance that uncertain measured states put on what is predicted from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.fitting.residuals import evaluate


def expected_spread(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that the uncertainty of the smoothed states puts on the predictions of the links.

    Each rate of a measured state, the least certain of what is smoothed, is shifted by ± its standard
    deviation and, because channels are read one after the other and the instant at which a motion turns is
    not known better, by ± one sample: both where it starts a window and where it is imposed. Half the
    difference of the predictions, squared, is summed. Zero where nothing counts.
    """
    pairs = {}
    for name in actuator.derivatives:
        values = problem.track.measured[name]
        pairs[name] = ((values + spread[name], values - spread[name]), _neighbours(values, problem))
    return spread_between(actuator, problem, pairs)


def spread_between(
    actuator: AbstractActuator, problem: Problem, pairs: Mapping[str, Iterable[tuple[Array, Array]]]
) -> Residuals:
    """Half the difference of the predictions under two values of a measured state, squared and summed.

    Zero where nothing counts.

    Args:
        pairs: name of a measured state → pairs of values along the recording, of which each adds a term.
    """

    def predicted(name: str, values: Array) -> Residuals:
        track = eqx.tree_at(lambda t: t.measured, problem.track, {**problem.track.measured, name: values})
        return evaluate(actuator, eqx.tree_at(lambda p: p.track, problem, track))  # pyright: ignore

    total = {out: jnp.zeros_like(target) for out, target in problem.targets.items()}
    for name, both in pairs.items():
        for one, other in both:
            up, down = predicted(name, one), predicted(name, other)
            total = {out: total[out] + (0.5 * (up[out] - down[out])) ** 2 for out in total}
    return {
        out: jnp.where(w > 0, total[out] / jnp.where(w > 0, w, 1.0) ** 2, 0.0)
        for out, w in problem.weights.items()
    }


def _neighbours(values: Array, problem: Problem) -> tuple[Array, Array]:
    """The value a sample before and a sample later; its own where that sample is none that counts.

    A held-out sample next to the windows must not reach even their weights.
    """
    rows = jnp.minimum(problem.rows[:, None] + jnp.arange(problem.samples), len(values) - 1)
    counted = [(w > 0).reshape(*rows.shape, -1).any(-1) for w in problem.weights.values()]
    counts = jnp.zeros(len(values), dtype=bool).at[rows].max(sum(counted[1:], start=counted[0]))
    late = jnp.where(jnp.roll(counts, 1).at[0].set(False).reshape(-1, *[1] * (values.ndim - 1)),
                     jnp.roll(values, 1, axis=0), values)  # fmt: skip
    early = jnp.where(jnp.roll(counts, -1).at[-1].set(False).reshape(-1, *[1] * (values.ndim - 1)),
                      jnp.roll(values, -1, axis=0), values)  # fmt: skip
    return late, early
