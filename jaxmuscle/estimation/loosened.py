"""Windows that may begin elsewhere than the smoothed readings say."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.stations import Station
from jaxmuscle.fitting.problem import Residuals
from jaxmuscle.fitting.residuals import BROKEN, evaluate

Line = NDArray[np.float64]

LOOSE = 3.0
"""Standard deviations of a smoothed reading by which a window may begin elsewhere.

Its own readings tell where; the smoothed one is made of the same readings and must hardly count beside them.
"""


def loosened(objective: Objective, u: Line) -> Objective:
    """`objective` with residuals made independent of the measured states with which windows begin.

    An error of a pressure or a position there runs through the whole window, and the fit would take it for
    the machine's: a time constant came out three standard deviations off, the same way in every draw of the
    noise. Each is an unknown of the window, normally distributed about the smoothed reading, and is
    eliminated (`whitening`), with the derivatives that it has at u. Rates are not among them: near sticking
    a prediction is no linear function of its first rate, so they lower weights instead (`spread`).
    """
    numbers = range(len(objective.stations))
    return dataclasses.replace(objective, stations=[_loosened(objective, i, u) for i in numbers])


def _loosened(objective: Objective, number: int, u: Line) -> Station:
    station = objective.stations[number]
    machine, problem = objective.moved(number, u)

    def residuals(name: str, states: Line) -> Residuals:
        measured = {**problem.track.measured, name: jnp.asarray(states)}
        return evaluate(machine, eqx.tree_at(lambda p: p.track.measured, problem, measured))

    found = []
    for name, reach in _begins(station):
        states = np.asarray(problem.track.measured[name])
        found.append(_change(station, residuals(name, states + reach), residuals(name, states - reach)))
    return dataclasses.replace(station, begins=tuple(found))


def _begins(station: Station) -> Iterator[tuple[str, Line]]:
    """Name of a measured state that no bench imposes, and by how much it may be off where windows begin.

    Of a state of several columns one column at a time.
    """
    rows = np.asarray(station.problem.rows)
    for name in (n for n in station.actuator.measured if n not in station.actuator.imposed):
        spread = np.asarray(station.spread[name])
        for column in np.ndindex(spread.shape[1:]):
            reach = np.zeros_like(spread)
            reach[(rows, *column)] = spread[(rows, *column)]
            yield name, reach


def _change(station: Station, up: Residuals, down: Residuals) -> dict[str, Line]:
    """Output → change of its prediction (SI) by `LOOSE` standard deviations; zero where it is no number."""
    found = {}
    for output, weights in station.problem.weights.items():
        one, other, weight = np.asarray(up[output]), np.asarray(down[output]), np.asarray(weights)
        sound = (weight > 0) & (np.abs(one) < BROKEN) & (np.abs(other) < BROKEN)
        found[output] = np.where(sound, LOOSE * 0.5 * (one - other) / np.where(sound, weight, 1.0), 0.0)
    return found
