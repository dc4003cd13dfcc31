"""The noise of the sensors as the residuals show it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective


def with_estimated_noise(objective: Objective, u: NDArray[np.float64]) -> Objective:
    """With the noise of each column of each recording as the size of its residuals at u.

    The size by the loss (`Loss.size`), which for squares is the maximum-likelihood estimate, and under a
    robust loss is right for normal noise. Each recording has its own: benches, ranges of a sensor and what
    the model lacks differ.
    """
    stations = []
    for number, station in enumerate(objective.stations):
        layout, factors = station.layout, {}
        for output, part in layout.split(objective.residuals(number, u[None])[0][0]).items():
            counted = np.where(layout.table(output, station.problem.weights[output]) > 0, part, np.nan)
            # A column of which nothing counts keeps what it has.
            size = np.nan_to_num(objective.loss.size(counted, (0, 1)), nan=1.0)
            factors[output] = 1 / np.maximum(size, 1e-6)
        stations.append(station.reweighted(factors))
    return dataclasses.replace(objective, stations=stations)
