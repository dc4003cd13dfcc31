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
        residual: measured against predicted, weighted, and independent of the states that begin windows.
        slopes: derivatives of the residual by all unknowns' coordinates.
        window: number of the window that a row belongs to, -1 for none.
        shared: what was taken off the residual to make it so.
    """

    recording: int
    output: str
    column: str
    counts: Bool[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]
    slopes: Float[np.ndarray, "k rows"]
    window: Int[np.ndarray, " rows"]
    shared: Float[np.ndarray, " rows"] | float = 0.0

    @property
    def deviation(self) -> Float[np.ndarray, " rows"]:
        """Predicted minus measured, weighted, with windows that begin as smoothed."""
        return self.residual + self.shared


def series(objective: Objective, u: NDArray[np.float64]) -> list[Series]:
    """All residuals of all recordings at coordinates u."""
    found = []
    for number, station in enumerate(objective.stations):
        deviation, slopes = (part[0] for part in objective.deviations(number, u[None]))
        residual, slopes = station.whitened(deviation), station.whitened(slopes)
        index, rows, layout = objective.unknowns.acting_on(number), len(station.recording), station.layout
        by_output = [layout.split(each) for each in (residual, deviation - residual, slopes)]
        for output, names in layout.columns.items():
            inside = layout.table(output, station.problem.weights[output]) > 0
            *both, tangents = (each[output] for each in by_output)
            for i, column in enumerate(names):
                where = layout.rows[inside[..., i]]
                counts, matrix = np.zeros(rows, dtype=bool), np.zeros((len(u), rows))
                counts[where] = True
                matrix[np.ix_(index, where)] = tangents[..., i][:, inside[..., i]]
                line, shared = (_placed(rows, where, each[..., i][inside[..., i]]) for each in both)
                window = np.full(rows, -1, dtype=np.int64)
                window[where] = np.nonzero(inside[..., i])[0]
                found.append(Series(number, output, column, counts, line, matrix, window, shared))
    return found


def _placed(rows: int, where: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at some rows of a recording, zero at the others."""
    line = np.zeros(rows)
    line[where] = values
    return line
