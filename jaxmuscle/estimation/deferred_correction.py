"""Deferred correction: a fit at the solver's step that ends where one with far smaller steps would."""

from __future__ import annotations

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle._traced_programs import KeptProgram
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.residuals import Stepping, residual_vector

RICHARDSON = 4 / 3
"""Error of a second-order method in the change that halving its steps makes."""
NOTICEABLE = 0.15
"""Shift of a parameter by the solver's error, in standard deviations, from which it is taken off."""
CONVERGING = 0.4
"""Ratio of the changes by two halvings in a row, 1/4 in theory, up to which the theory can be relied on."""


@KeptProgram
def _residuals(actuator, problem, times):
    """Residuals with `times` as many steps; one compilation for all of them, whatever is free."""
    stepping = Stepping(problem.substeps * times)
    return residual_vector(jnp.zeros(0), actuator, problem, (), stepping)


def refined(objective: Objective, u: NDArray[np.float64], matrix: Float[np.ndarray, "k k"]) -> Objective:
    r"""`objective` with the solver's error at u taken off its residuals (deferred correction).

    A rig's longest step keeps the solver's error below the noise of a reading, but a parameter is known far
    better than a reading is. The residuals r_h at steps h become :math:`r_h + \frac43 (r_{h/2} - r_h)`,
    the bracket as it is at u; derivatives stay those at h. An output whose next halving does not change it
    by a quarter of that is left as it is: where dry friction sticks and slips, a smaller step is not nearer
    to the truth sample by sample. Nothing is done where no parameter would move by more than 0.15 of its
    standard deviation.

    Args:
        matrix: of Gauss and Newton at u.
    """
    if all(math.isinf(station.actuator.largest_step) for station in objective.stations):
        return objective
    changes, pull = [], np.zeros(len(u))
    for number in range(len(objective.stations)):
        station = objective.stations[number]
        coarse, slopes = (part[0] for part in objective.deviations(number, u[None]))
        change = RICHARDSON * _change(objective, number, u, coarse)
        residuals = station.whitened(np.where(np.isfinite(coarse), coarse, 0.0))
        scores = objective.loss.weight(residuals) * station.whitened(change)
        pull[objective.unknowns.acting_on(number)] += station.whitened(slopes) @ scores
        changes.append(change)
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(size, size) + 1e-10 * np.eye(len(u))
    # Both in units of the standard deviations that the parameters would have one by one.
    inverse = np.linalg.inv(scaled)
    shift = inverse @ (pull / size) / np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    if not np.abs(shift).max() > NOTICEABLE:
        return objective
    stations = [_shifted(s, change) for s, change in zip(objective.stations, changes, strict=True)]
    return dataclasses.replace(objective, stations=stations)


def _change(
    objective: Objective, number: int, u: NDArray[np.float64], coarse: NDArray[np.float64]
) -> NDArray[np.float64]:
    """r_{h/2} - r_h of one recording, zero for outputs that do not converge with the order of the method."""
    change = np.zeros_like(coarse)
    fine, finer = (_at_steps(objective, number, u, times) for times in (2, 4))
    for part in objective.stations[number].layout.parts().values():
        first, second = fine[part] - coarse[part], finer[part] - fine[part]
        sound = np.isfinite(first) & np.isfinite(second)
        first, second = np.where(sound, first, 0.0), np.where(sound, second, 0.0)
        if np.linalg.norm(second) <= CONVERGING * np.linalg.norm(first):
            change[part] = first
    return change


def _at_steps(objective: Objective, number: int, u: NDArray[np.float64], times: int) -> NDArray[np.float64]:
    """Residuals of one recording with so many times the solver's steps."""
    station = objective.stations[number]
    machine, problem = objective.moved(number, u, station.common)
    return station.own(_residuals(machine, problem, jnp.asarray(times)))  # pyright: ignore


def _shifted(station: Station, change: NDArray[np.float64]) -> Station:
    """With targets such that every residual is larger by `change`."""
    problem, targets = station.problem, dict(station.problem.targets)
    for output, part in station.layout.split(change).items():
        weights = np.asarray(problem.weights[output])
        off = np.where(weights > 0, part.reshape(weights.shape) / np.where(weights > 0, weights, 1.0), 0.0)
        targets[output] = jnp.asarray(np.asarray(targets[output]) - off)
    return dataclasses.replace(station, problem=eqx.tree_at(lambda p: p.targets, problem, targets))
