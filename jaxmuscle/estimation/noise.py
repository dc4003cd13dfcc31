"""The noise of the sensors as the residuals show it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective


def with_estimated_noise(objective: Objective, u: NDArray[np.float64], lanes: int) -> Objective:
    """With the noise of each column as the size of its residuals at u, over all recordings.

    The root of the mean weighted square, residuals weighted as the loss does, which for squares is the
    maximum-likelihood estimate.
    """
    sums: dict[str, NDArray] = {}
    counts: dict[str, NDArray] = {}
    for number, station in enumerate(objective.stations):
        r, begin = objective.residuals(number, np.stack([u] * lanes))[0][0], 0
        for link in station.actuator.links:
            w = np.asarray(station.problem.weights[link.output])
            part = r[begin : begin + w.size].reshape(*w.shape[:2], -1)
            begin += w.size
            inside = (w > 0).reshape(part.shape)
            squares = (objective.loss.weight(part) * part**2 * inside).sum(axis=(0, 1))
            mass = (objective.loss.weight(part) * inside).sum(axis=(0, 1))
            sums[link.output] = sums.get(link.output, 0.0) + squares
            counts[link.output] = counts.get(link.output, 0.0) + mass
    factors = {out: 1 / np.sqrt(np.maximum(sums[out] / counts[out], 1e-12)) for out in sums}
    stations = [station.reweighted(factors) for station in objective.stations]
    return dataclasses.replace(objective, stations=stations)
