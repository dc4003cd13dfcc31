"""Weights that allow for what the smoothed measured states leave uncertain."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.stations import Station
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.fitting.spread import expected_spread, spread_between

SPREAD = 2.0
"""Standard deviations by which rates are shifted where windows begin with them."""


def weighted(objective: Objective, u: NDArray[np.float64]) -> Objective:
    """`objective` with weights that allow for uncertain states at the coordinates u."""
    numbers = range(len(objective.stations))
    return dataclasses.replace(objective, stations=[_weighted(objective, i, u) for i in numbers])


def variance(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that uncertain rates of the measured states put on the predictions of the links.

    Where a window begins with them, as in a diagnosis (`fitting.spread.expected_spread`): each rate shifted
    by ± two standard deviations and by ± one sample. Where a bench imposes them, that would hide what the
    data say of fast motion: a rate is shifted by ± its standard deviation, and by a sample only where the
    motion turns, since dry friction turns there with it. Half the difference of the predictions, squared.
    """
    if not set(actuator.derivatives) <= set(actuator.imposed):
        return expected_spread(actuator, problem, {n: SPREAD * values for n, values in spread.items()})

    pairs = {}
    for name in actuator.derivatives:
        values, size = np.asarray(problem.track.measured[name]), np.asarray(spread[name])
        late, early = np.concatenate([values[:1], values[:-1]]), np.concatenate([values[1:], values[-1:]])
        turning = late * early <= 0
        late, early = np.where(turning, late, values), np.where(turning, early, values)
        pairs[name] = ((values + size, values - size), (late, early))
    return spread_between(actuator, problem, pairs)


def _weighted(objective: Objective, number: int, u: NDArray[np.float64]) -> Station:
    station = objective.stations[number]
    machine, problem = objective.moved(number, u)
    # An offset moves targets, not weights.
    return dataclasses.replace(
        station, problem=station.problem.allowing(variance(machine, problem, station.spread))
    )
