"""Residual analysis: residuals in time with their derivatives, tests of whiteness and of independence from
the input.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray
from scipy.stats import chi2

from jaxmuscle.estimation.coloured_noise import autocovariance, coloured_meat, pairs, stride
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
                matrix[index[:, None], where] = tangents[..., i][:, inside[..., i]]
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


LAGS = 25
CONFIDENCE = 0.99
"""Of the bands and of the joint tests."""
NORMAL = 2.5758
"""Quantile of the normal distribution that belongs to it."""
FEWEST = 20
"""Pairs of readings from which an autocorrelation is looked at."""
DISTINCT = 1e-2
"""Singular value of the shifted inputs, relative to the largest, from which they are told apart."""


@dataclasses.dataclass(frozen=True)
class ResidualTest:
    """Correlations of the residuals of one column, with the band that 99 % of them should lie in.

    Attributes:
        against: "itself", or the name of an input.
        lags: in samples; an input leads the residuals at positive lags.
        band: half-width, lag by lag.
        p_value: of all lags together, if the residuals were white (and independent of the input).
    """

    recording: str
    column: str
    against: str
    lags: NDArray[np.int64]
    correlation: NDArray[np.float64]
    band: NDArray[np.float64]
    p_value: float

    @property
    def passed(self) -> bool:
        """Whether the joint test is passed at 1 %."""
        return self.p_value >= 1 - CONFIDENCE

    @property
    def outside(self) -> float:
        """Part of the lags outside the band; 1 % is to be expected."""
        return float((np.abs(self.correlation) > self.band).mean()) if len(self.lags) else 0.0


def whiteness(line: Series, label: str) -> ResidualTest:
    r"""Autocorrelation at the lags 1 … 25 (Box and Pierce; Ljung, System Identification 16.5).

    Over n readings, at every lag by the m(l) pairs of them: :math:`Q = (n + 2)/n \sum_l m(l) ρ(l)^2`, that of
    Ljung and Box (1978) where no reading is missing (Stoffer and Toloi, Statistics and Probability Letters 13
    (1992), for series with gaps). Lags of fewer than 20 pairs are left out; of a sensor that is slower
    than the clock they are multiples of its own step.
    """
    n, lags = int(line.counts.sum()), _lags(line.counts)
    last = int(lags.max(initial=0))
    gamma, many = autocovariance(line.residual, line.counts, last), pairs(line.counts, last)[lags]
    rho = gamma[lags] / max(gamma[0], 1e-300)
    statistic = (n + 2) / n * float((many * rho**2).sum())
    p_value = float(chi2.sf(statistic, len(lags))) if len(lags) else 1.0
    return ResidualTest(label, line.column, "itself", lags, rho, NORMAL / np.sqrt(many), p_value)


def independence(line: Series, label: str, name: str, given: NDArray[np.float64]) -> ResidualTest:
    r"""Cross-correlation of the residuals with an input at lags -5 … 20.

    Ljung, System Identification (1999) 16.6: :math:`\sqrt{N} R_{εu}(τ)` is normal with the variance
    :math:`\sum_{t,s} u(t-τ) R_v(t-s) u(s-τ) / N` over the rows that count, which allows for residuals that
    are not white. v are the residuals without their regression on the input at these lags: a dependence on
    the input is no noise, in which a slow input would hide it.

    The largest squared correlation over its variance is below that of the best combination of all lags,
    which is χ² with as many degrees of freedom as the shifted inputs have directions; this or Bonferroni's
    bound, whichever is sharper, gives the p-value.
    """
    counts = line.counts
    residual = np.where(counts, line.residual, 0.0)
    lags = np.arange(-5, LAGS - 4)
    shifted = _shifted(given - given[counts].mean(), lags) * counts
    values, across = np.linalg.eigh(shifted @ shifted.T)
    # Neighbouring lags of a smooth input tell the same.
    told = values > DISTINCT**2 * values[-1]
    weights = across[:, told] * np.sqrt(values[told])
    along = (across[:, told] / np.sqrt(values[told])).T @ shifted
    own = residual - along.T @ (along @ residual)
    meat = coloured_meat(along, own, counts)
    variance = np.maximum(np.einsum("ij,jk,ik->i", weights, meat, weights), 1e-300)
    cross = weights @ (along @ residual)
    scale = max(np.linalg.norm(residual) * np.linalg.norm(shifted[5]), 1e-300)
    largest = float((cross**2 / variance).max())
    bounds = len(lags) * float(chi2.sf(largest, 1)), float(chi2.sf(largest, int(told.sum())))
    band = NORMAL * np.sqrt(variance) / scale
    return ResidualTest(label, line.column, name, lags, cross / scale, band, min(*bounds, 1.0))


def residual_tests(
    lines: Sequence[Series], labels: Sequence[str], inputs: Sequence[dict[str, NDArray[np.float64]]]
) -> tuple[ResidualTest, ...]:
    """Whiteness of every column's residuals and their independence of every input that moves.

    Args:
        inputs: for each recording, input → its samples.
    """
    found = []
    for line in lines:
        if int(line.counts.sum()) <= 2 * LAGS or not np.any(line.residual):
            continue
        if len(_lags(line.counts)):
            found.append(whiteness(line, labels[line.recording]))
        found += [
            independence(line, labels[line.recording], name, values)
            for name, values in inputs[line.recording].items()
            if np.ptp(values[line.counts]) > 0
        ]
    return tuple(found)


def _lags(counts: Bool[np.ndarray, " n"]) -> NDArray[np.int64]:
    """Lags at which enough pairs of rows count."""
    lags = stride(counts) * np.arange(1, LAGS + 1)
    lags = lags[lags < len(counts)]
    return lags[pairs(counts, int(lags.max(initial=0)))[lags] >= FEWEST]


def _shifted(given: NDArray[np.float64], lags: NDArray[np.int64]) -> Float[np.ndarray, "lags n"]:
    """given(t - lag), zero before its beginning and after its end."""
    n, reach = len(given), int(np.abs(lags).max())
    padded = np.pad(given, reach)
    return np.stack([padded[reach - lag : reach - lag + n] for lag in lags])
