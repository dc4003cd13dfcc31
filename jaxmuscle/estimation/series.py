"""Residuals of a fit as they follow each other in time, with their derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective


@dataclasses.dataclass(frozen=True)
class Series:
    """Residuals of one column of one recording, in units of its noise, on the recording's clock.

    Attributes:
        recording, output, column: which one; `recording` is a number.
        counts: rows that count; everything else is zero elsewhere.
        residual: measured against predicted, weighted.
        slopes: derivatives of the residual by all unknowns' coordinates.
        window: number of the window that a row belongs to, -1 for none.
    """

    recording: int
    output: str
    column: str
    counts: Bool[NDArray[np.bool_], " rows"]
    residual: Float[NDArray, " rows"]
    slopes: Float[NDArray, "k rows"]
    window: Int[NDArray[np.int64], " rows"]


def series(objective: Objective, u: NDArray[np.float64]) -> list[Series]:
    """All residuals of all recordings at coordinates u."""
    found = []
    for number, station in enumerate(objective.stations):
        residual, slopes = (part[0] for part in objective.residuals(number, u[None]))
        index, begin, rows = objective.unknowns.acting_on(number), 0, len(station.recording)
        at = np.asarray(station.problem.rows)[:, None] + np.arange(station.problem.samples)
        for link in station.actuator.links:
            weights = np.asarray(station.problem.weights[link.output])
            part = slice(begin, begin + weights.size)
            begin += weights.size
            names = station.actuator.outputs[link.output]
            shape = (*weights.shape[:2], len(names))
            weights, values = weights.reshape(shape), residual[part].reshape(shape)
            tangents = slopes[:, part].reshape(-1, *shape)
            for i, column in enumerate(names):
                inside = weights[..., i] > 0
                counts, where = np.zeros(rows, dtype=bool), at[inside]
                counts[where] = True
                line, matrix = np.zeros(rows), np.zeros((len(u), rows))
                line[where] = values[..., i][inside]
                matrix[np.ix_(index, where)] = tangents[..., i][:, inside]
                window = np.full(rows, -1, dtype=np.int64)
                window[where] = np.broadcast_to(np.arange(len(at))[:, None], at.shape)[inside]
                found.append(Series(number, link.output, column, counts, line, matrix, window))
    return found
