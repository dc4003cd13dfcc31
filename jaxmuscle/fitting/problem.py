"""Residuals of a machine on a recording: each link of the chain, each window, each sample."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxmuscle.actuators.base import AbstractActuator, Link
from jaxmuscle.effects.base import widened_friction
from jaxmuscle.fitting.windows import Windows
from jaxmuscle.parameters import split_index
from jaxmuscle.recordings.track import Observed
from jaxmuscle.simulation import Start, Track, observe, predict, run, start_at_rest

BROKEN = 1e4
"""Residual that stands for a prediction that is not a number: large, but no end to the fit."""

Residuals = dict[str, Float[Array, "windows samples *muscles"]]


class Problem(eqx.Module):
    """A recording cut into windows, with a weight for every predicted number.

    Attributes:
        targets: output → measured values, window by window.
        weights: output → one over the standard deviation to be expected of the residual, zero where masked.
        period: samples after which a link is started anew from what was measured; a window, or part of one.
        begin: states at the first sample of the recording that are neither as measured nor at rest: name of
            a state, or of the effect whose state it is (an entry of an array by its index), → value.
        widening: how many times as wide as it is dry friction is smoothed.
    """

    track: Track
    rows: Int[Array, " windows"]
    targets: Residuals
    weights: Residuals
    period: Int[Array, ""]
    samples: int = eqx.field(static=True)
    total: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    begin: dict[str, Array] = eqx.field(default_factory=dict)
    widening: Array | None = None

    def with_weights(self, weights: Residuals) -> Problem:
        """A copy with other weights."""
        return eqx.tree_at(lambda p: p.weights, self, weights)

    def in_parts(self, parts: int) -> Problem:
        """A copy in which every window is predicted in `parts`, each from the measured state.

        Errors have less time to grow, and the more so the nearer a motion is to sticking: the cost of a
        fit is a far smoother function of the parameters.
        """
        return eqx.tree_at(lambda p: p.period, self, jnp.asarray(-(-self.samples // parts)))

    def only(self, samples: np.ndarray) -> Problem:
        """A copy in which only the given samples count: boolean, one row a window."""
        return self.with_weights({o: w * _along(samples, w) for o, w in self.weights.items()})


def problem(observed: Observed, windows: Windows, substeps: int) -> Problem:
    """Cut `observed` into `windows`, weighted by the sensors' noise."""
    index = np.minimum(windows.rows[:, None] + np.arange(windows.samples), observed.samples - 1)
    targets = {out: values[index] for out, values in observed.outputs.items()}
    weights = {
        out: jnp.asarray(windows.mask).reshape(windows.mask.shape + (1,) * (target.ndim - 2))
        / jnp.broadcast_to(observed.noise[out], target.shape)
        for out, target in targets.items()
    }
    return Problem(
        observed.track,
        jnp.asarray(windows.rows),
        targets,
        weights,
        jnp.asarray(windows.samples),
        windows.samples,
        observed.samples,
        substeps,
    )


def link_predictions(
    actuator: AbstractActuator, problem: Problem, substeps: int | Array | None = None
) -> Residuals:
    """Every output predicted by its own link, the inputs of the link as measured.

    Args:
        substeps: solver steps between two samples; the problem's when `None`.
    """
    steps: Any = problem.substeps if substeps is None else substeps
    problem = _begun(problem)
    if problem.widening is not None:
        with widened_friction(problem.widening):
            return _links(actuator, problem, steps)
    return _links(actuator, problem, steps)


def _links(actuator: AbstractActuator, problem: Problem, steps: Any) -> Residuals:
    hidden = _hidden(actuator, problem, steps)
    return {link.output: _predict(actuator, problem, link, hidden, steps) for link in actuator.links}


def chain_predictions(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Every output predicted from the command alone, window by window."""
    problem = _begun(problem)
    hidden = _hidden(actuator, problem, problem.substeps)
    return predict(
        actuator,
        problem.track,
        problem.rows,
        samples=problem.samples,
        imposed=actuator.imposed,
        substeps=problem.substeps,
        hidden=hidden,
    )


def residuals(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Weighted residuals (predicted - measured) of all links."""
    predicted = link_predictions(actuator, problem)
    return {out: weighted(predicted[out], problem, out) for out in predicted}


def weighted(predicted: Array, problem: Problem, output: str) -> Array:
    """Weighted residual of one output; what is not a number counts as :data:`BROKEN`."""
    residual = (predicted - problem.targets[output]) * problem.weights[output]
    return jnp.where(jnp.isfinite(residual), jnp.clip(residual, -BROKEN, BROKEN), BROKEN)


evaluate = eqx.filter_jit(residuals)
"""Weighted residuals, compiled once for each structure of a model."""


def expected_spread(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that the uncertainty of the smoothed states puts on the predictions of the links.

    Each rate of a measured state, the least certain of what is smoothed, is shifted by ± its standard
    deviation and, because channels are read one after the other and the instant at which a motion turns is
    not known better, by ± one sample: both where it starts a window and where it is imposed. Half the
    difference of the predictions, squared, is summed. Zero where nothing counts.
    """

    def predicted(name: str, values: Array) -> Residuals:
        track = eqx.tree_at(lambda t: t.measured, problem.track, {**problem.track.measured, name: values})
        return evaluate(actuator, eqx.tree_at(lambda p: p.track, problem, track))  # pyright: ignore

    total = {out: jnp.zeros_like(target) for out, target in problem.targets.items()}
    for name in actuator.derivatives:
        values = problem.track.measured[name]
        late, early = _neighbours(values, problem)
        for one, other in ((values + spread[name], values - spread[name]), (late, early)):
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


def _begun(problem: Problem) -> Problem:
    """With the measured states of the first sample as `begin` says."""
    measured = dict(problem.track.measured)
    for path, value in problem.begin.items():
        name, index = split_index(path)
        if name in measured:
            measured[name] = measured[name].at[(0, *(index or ()))].set(value)
    return eqx.tree_at(lambda p: p.track.measured, problem, measured)


def _hidden(actuator: AbstractActuator, problem: Problem, substeps: Any) -> Start:
    """The states that are not measured, carried along the recording from rest, or from what `begin` says."""
    track = problem.track
    own = {p: value for p, value in problem.begin.items() if split_index(p)[0] not in track.measured}
    if not own:
        return observe(actuator, track, problem.total, substeps)
    imposed = (*actuator.measured, *actuator.derivatives)
    rest = start_at_rest(actuator, track)
    state, memory = {**rest.state, "effects": dict(rest.state["effects"])}, dict(rest.memory)
    for path, value in own.items():
        name, index = split_index(path)
        place = next(group for group in (state, state["effects"], memory) if name in group)
        place[name] = place[name].at[index or ()].set(value)
    return run(
        actuator,
        track,
        Start(state, memory),
        jnp.asarray(0),
        samples=problem.total,
        imposed=imposed,
        substeps=substeps,
        keep=tuple(name for name in state if name not in imposed),
    ).states


def _predict(actuator: AbstractActuator, problem: Problem, link: Link, hidden: Start, substeps: Any) -> Array:
    return predict(
        actuator,
        problem.track,
        problem.rows,
        samples=problem.samples,
        imposed=(*link.imposed, *(n for n in actuator.imposed if n not in link.imposed)),
        substeps=substeps,
        hidden=hidden,
        period=problem.period,
    )[link.output]


def _along(samples: np.ndarray, weights: Array) -> Array:
    return jnp.asarray(samples, dtype=float).reshape(samples.shape + (1,) * (weights.ndim - 2))
