"""What a machine predicts on a recording: each link of the chain, or the whole chain, window by window."""

from __future__ import annotations

from typing import Any

import equinox as eqx
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, Link
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.parameters import split_index
from jaxmuscle.simulation import Start, observe, predict, start_at_rest, with_states


def link_predictions(
    actuator: AbstractActuator, problem: Problem, substeps: int | Array | None = None
) -> Residuals:
    """Every output predicted by its own link, the inputs of the link as measured.

    Args:
        substeps: solver steps between two samples; the problem's when `None`.
    """
    hidden = hidden_states(actuator, problem, substeps)
    return {
        link.output: link_prediction(actuator, problem, link, hidden, substeps) for link in actuator.links
    }


def link_prediction(
    actuator: AbstractActuator,
    problem: Problem,
    link: Link,
    hidden: Start,
    substeps: int | Array | None = None,
) -> Array:
    """The output of one link, its inputs as measured and the states that are not from `hidden`."""
    steps: Any = problem.substeps if substeps is None else substeps
    return predict(
        actuator,
        _begun(problem).track,
        problem.rows,
        samples=problem.samples,
        imposed=(*link.imposed, *(n for n in actuator.imposed if n not in link.imposed)),
        substeps=steps,
        hidden=hidden,
        period=problem.period,
    )[link.output]


def hidden_states(actuator: AbstractActuator, problem: Problem, substeps: int | Array | None = None) -> Start:
    """The states that are not measured, carried along the recording from rest, or from what `begin` says."""
    steps: Any = problem.substeps if substeps is None else substeps
    track = _begun(problem).track
    own = {p: value for p, value in problem.begin.items() if split_index(p)[0] not in track.measured}
    start = with_states(start_at_rest(actuator, track), own)
    return observe(actuator, track, problem.total, steps, start)


def chain_predictions(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Every output predicted from the command alone, window by window."""
    hidden, problem = hidden_states(actuator, problem), _begun(problem)
    return predict(
        actuator,
        problem.track,
        problem.rows,
        samples=problem.samples,
        imposed=actuator.imposed,
        substeps=problem.substeps,
        hidden=hidden,
    )


def _begun(problem: Problem) -> Problem:
    """With the measured states of the first sample as `begin` says."""
    measured = dict(problem.track.measured)
    for path, value in problem.begin.items():
        name, index = split_index(path)
        if name in measured:
            measured[name] = measured[name].at[(0, *(index or ()))].set(value)
    return eqx.tree_at(lambda p: p.track.measured, problem, measured)
