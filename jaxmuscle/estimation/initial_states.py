"""Uncertain initial states of windows: eliminated from the fit, or counted in its covariance by their
scores.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.estimation.residuals import Evaluated, evaluate
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN

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

    def residuals(name: str, states: Line) -> Evaluated:
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
        spread = station.problem.track.start_spread(name, station.spread[name])
        for column in np.ndindex(spread.shape[1:]):
            reach = np.zeros_like(spread)
            reach[(rows, *column)] = spread[(rows, *column)]
            yield name, reach


def _change(station: Station, up: Evaluated, down: Evaluated) -> dict[str, Line]:
    """Output → change of its prediction (SI) by `LOOSE` standard deviations; zero where it is no number."""
    found = {}
    for output, weights in station.problem.weights.items():
        one, other, weight = np.asarray(up[output]), np.asarray(down[output]), np.asarray(weights)
        sound = (weight > 0) & (np.abs(one) < BROKEN) & (np.abs(other) < BROKEN)
        found[output] = np.where(sound, LOOSE * 0.5 * (one - other) / np.where(sound, weight, 1.0), 0.0)
    return found


INSTANT = 3**-0.5
"""Standard deviation of the instant of a reading, in samples: it is not known better than ± one sample."""


def state_scores(objective: Objective, u: Line, lines: list[Series]) -> Float[np.ndarray, "sources k"]:
    """How the score Σ J ψ changes by one standard deviation of each rate at the beginning of each window.

    An error there runs through the whole window: its residuals go together, and in a few windows their own
    size tells little of it. A rate is uncertain by the smoothing and by the instant of its reading. None
    where the bench imposes the rates, which enter sample by sample.
    """
    found = []
    for number, station in enumerate(objective.stations):
        own = [line for line in lines if line.recording == number]
        for change in _changes(objective, number, u):
            found += _scores(objective, station, own, change)
    return np.array(found).reshape(-1, len(u))


def _changes(objective: Objective, number: int, u: Line) -> list[dict[str, Line]]:
    """Output → change of its residuals, for each rate and each reason of its uncertainty."""
    station = objective.stations[number]
    machine, problem = objective.moved(number, u)

    def residuals(name: str, rates: Line) -> dict[str, Line]:
        measured = {**problem.track.measured, name: jnp.asarray(rates)}
        found = evaluate(machine, eqx.tree_at(lambda p: p.track.measured, problem, measured))
        return {output: np.asarray(each) for output, each in found.items()}

    found = []
    for name in (n for n in station.actuator.derivatives if n not in station.actuator.imposed):
        rates = np.asarray(problem.track.measured[name])
        spread = problem.track.start_spread(name, station.spread[name])
        later, earlier = (INSTANT * (each - rates) for each in _neighbours(problem, rates))
        for up, down in ((spread, -spread), (later, earlier)):
            one, other = residuals(name, rates + up), residuals(name, rates + down)
            sound = {o: (np.abs(one[o]) < BROKEN) & (np.abs(other[o]) < BROKEN) for o in one}
            change = {o: np.where(sound[o], 0.5 * (one[o] - other[o]), 0.0) for o in one}
            found.append(_independent(station, change))
    return found


def _independent(station: Station, change: dict[str, Line]) -> dict[str, Line]:
    """Without what is shared with the other states that begin windows."""
    return station.layout.split(station.whitened(station.layout.join(change)))


def _neighbours(problem: Problem, rates: Line) -> tuple[Line, Line]:
    """The rates a sample later and a sample earlier, of the same run."""
    begins = problem.track.begins
    first = np.zeros(len(rates), dtype=bool) if begins is None else np.array(begins)
    first[0] = True
    last = np.append(first[1:], True)
    along = (-1, *[1] * (rates.ndim - 1))
    later = np.where(last.reshape(along), rates, np.roll(rates, -1, axis=0))
    return later, np.where(first.reshape(along), rates, np.roll(rates, 1, axis=0))


def _scores(
    objective: Objective, station: Station, lines: list[Series], change: dict[str, Line]
) -> list[Line]:
    """Σ J ψ' times the change, over the columns and rows of each window."""
    layout = station.layout
    scores = np.zeros((len(layout.rows), len(lines[0].slopes)))
    for line in lines:
        column = layout.columns[line.output].index(line.column)
        counts = layout.table(line.output, station.problem.weights[line.output])[..., column] > 0
        along = np.zeros(len(line.counts))
        along[layout.rows[counts]] = change[line.output][..., column][counts]
        products = line.slopes * objective.loss.slope(line.residual) * along
        inside = line.window >= 0
        np.add.at(scores, line.window[inside], products[:, inside].T)
    return [score for score in scores if score.any()]
