"""Inputs of links as the model predicts them from the command, in place of the readings of a noisy sensor."""

from __future__ import annotations

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.residuals import evaluate_chain
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN

Line = Float[np.ndarray, "..."]

TRUSTED = 2.0
"""Root mean square of a predicted input from its reading, in units of the sensor's noise, up to which it may
take the reading's place: what it is off by is then no more than what the reading is off by. Right models
leave 1.0 to 1.8 of a pressure, under coloured noise too (joints and lifts that were drawn)."""


def with_predicted_inputs(model: AbstractActuator, measured: Problem) -> Problem:
    """The windows of `measured` with inputs of links as `model` predicts them; itself where it cannot.

    A link takes its inputs as they were measured, and their noise moves its prediction: a joint turns by
    several noise units with an error of a pressure that lasts for a second. Where the model is right about
    such an input, what it predicts of it has nothing of the sensor's noise (as an instrumental variable:
    Young, Recursive Estimation and Time-Series Analysis, 2011). It takes the reading's place where both agree
    (:data:`TRUSTED`). Values are predicted from the command alone, window by window from the state measured
    where the window begins; where readings do not count they stay as they are. The prediction of the input's
    own link would not do: that of a lift's pressure has the measured position in it, which the next link is
    to predict.

    Whether it is better than the input as measured, fits with both have to tell (:func:`predicts_better`): a
    model that was fitted with inputs as measured is bent to their errors.

    Args:
        measured: windows, whole or cut into parts, inputs as measured.
    """
    inputs = predictable_inputs(model)
    if not inputs:
        return measured
    predicted, chosen = evaluate_chain(model, measured), measured
    for state, output in inputs.items():
        if _off(measured, output, predicted[output]) <= TRUSTED:
            series = _along_recording(measured, state, predicted[output], output)
            chosen = _with_input(chosen, state, series)
    return chosen


def command_errors(model: AbstractActuator, problem: Problem) -> Float[np.ndarray, " windows"]:
    """Errors of predictions from the command alone, window by window.

    Of each window the sum over outputs of ln(1 + m), m the mean square in units of the noise.
    """
    found = np.zeros(len(problem.rows))
    for output, predicted in evaluate_chain(model, problem).items():
        weights = np.asarray(problem.weights[output]).reshape(len(found), -1)
        off = (predicted - np.asarray(problem.targets[output])).reshape(weights.shape)
        squares = np.where(weights > 0, np.nan_to_num(off * weights, nan=BROKEN), 0.0) ** 2
        found += np.log1p(squares.sum(axis=1) / np.maximum((weights > 0).sum(axis=1), 1))
    return found


SURE = 2.0
"""Standard errors, over windows, by which a fit has to predict better from the command alone to be taken.

With none, machines with white noise, to which inputs do little, came out worse on data that no fit saw:
practice recording 04 with 9.8 noise units of its position for 4.3, 12 with 6.8 of its angle for 4.9.
"""


def predicts_better(one: Float[np.ndarray, " windows"], other: Float[np.ndarray, " windows"]) -> bool:
    """Whether one of two fits surely predicts windows better, by :func:`command_errors` of both."""
    better = other - one
    spread = better.std(ddof=1) / np.sqrt(len(better)) if len(better) > 1 else 0.0
    return bool(better.mean() > SURE * spread)


def with_inputs_of(problem: Problem, other: Problem) -> Problem:
    """A copy with the measured states of another problem of the same recording; itself if it has them."""
    if other.track.measured is problem.track.measured:
        return problem
    return eqx.tree_at(lambda p: p.track.measured, problem, other.track.measured)


def predictable_inputs(model: AbstractActuator) -> Mapping[str, str]:
    """State that a link takes as measured → output that predicts its readings, where there is one.

    What has a rate that is an input, too, stays as measured with it.
    """
    given = {name for link in model.links for name in link.imposed if name not in model.imposed}
    by_columns = {names: output for output, names in model.outputs.items()}
    return {
        state: by_columns[columns]
        for state, columns in model.measured.items()
        if state in given and columns in by_columns and state not in model.derivatives.values()
    }


def _off(problem: Problem, output: str, predicted: Line) -> float:
    """Root mean square of a prediction from the readings that count, in units of their noise."""
    weights = np.asarray(problem.weights[output])
    with np.errstate(invalid="ignore"):
        off = (predicted - np.asarray(problem.targets[output])) * weights
    off = off[weights > 0]
    return float(np.sqrt((off**2).mean())) if np.isfinite(off).all() and off.size else np.inf


def _along_recording(problem: Problem, state: str, predicted: Line, output: str) -> Array:
    """The state along the recording: predicted where a reading counts, else as it was measured."""
    series = np.array(problem.track.measured[state])
    there = (np.asarray(problem.weights[output]) > 0) & np.isfinite(predicted)
    window, sample, *column = np.nonzero(there)
    series[(problem.sample_rows[window, sample], *column)] = np.asarray(predicted)[there]
    return jnp.asarray(series)


def _with_input(problem: Problem, state: str, values: Array) -> Problem:
    measured = {**problem.track.measured, state: values}
    return eqx.tree_at(lambda p: p.track.measured, problem, measured)
