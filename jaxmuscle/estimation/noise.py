"""The noise of the sensors as the residuals show it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective


def with_estimated_noise(objective: Objective, u: NDArray[np.float64]) -> Objective:
    """With the noise of each column of each recording as the size of its residuals at u.

    The root of the mean weighted square, residuals weighted as the loss does, which for squares is the
    maximum-likelihood estimate. Each recording has its own: benches, ranges of a sensor and what the model
    lacks differ.
    """
    stations = []
    for number, station in enumerate(objective.stations):
        r, begin, factors = objective.residuals(number, u[None])[0][0], 0, {}
        for link in station.actuator.links:
            w = np.asarray(station.problem.weights[link.output])
            part = r[begin : begin + w.size].reshape(*w.shape[:2], -1)
            begin += w.size
            mass = objective.loss.weight(part) * (w > 0).reshape(part.shape)
            squares = (mass * part**2).sum(axis=(0, 1)) / mass.sum(axis=(0, 1))
            factors[link.output] = 1 / np.sqrt(np.maximum(squares, 1e-12))
        stations.append(station.reweighted(factors))
    return dataclasses.replace(objective, stations=stations)
