"""Tests of the residuals: white, and independent of the input?"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from jaxmuscle.estimation.correlation import autocovariance
from jaxmuscle.estimation.series import Series

LAGS = 25
CONFIDENCE = 0.99
"""Of the bands and of the joint tests."""
NORMAL = 2.5758
"""Quantile of the normal distribution that belongs to it."""


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
        return float((np.abs(self.correlation) > self.band).mean())


def whiteness(line: Series, label: str) -> ResidualTest:
    """Autocorrelation at lags 1 … 25 (Box and Pierce; Ljung, System Identification 16.5)."""
    n = int(line.counts.sum())
    gamma = autocovariance(line.residual, line.counts, LAGS)
    rho = gamma[1:] / max(gamma[0], 1e-300)
    lags = np.arange(1, len(gamma))
    statistic = n * (n + 2) * float((rho**2 / np.maximum(n - lags, 1)).sum())
    band = np.full(len(rho), NORMAL / np.sqrt(max(n, 1)))
    return ResidualTest(label, line.column, "itself", lags, rho, band, float(chi2.sf(statistic, len(rho))))


def independence(line: Series, label: str, name: str, given: NDArray[np.float64]) -> ResidualTest:
    r"""Cross-correlation of the residuals with an input at lags -5 … 20.

    Ljung, System Identification (1999) 16.6: :math:`\sqrt{N} R_{εu}(τ)` is normal with variance
    :math:`\sum_l R_ε(l) R_u(l)`, which allows for residuals that are not white.
    """
    counts = line.counts
    n = int(counts.sum())
    centred = np.where(counts, given - given[counts].mean(), 0.0)
    residual = np.where(counts, line.residual, 0.0)
    lags = np.arange(-5, LAGS - 4)
    cross = np.array([_shifted_product(centred, residual, int(lag)) for lag in lags]) / n
    many = min(4 * LAGS, len(given) - 1)
    own, of_input = autocovariance(residual, counts, many), autocovariance(centred, counts, many)
    products = own * of_input * (1 - np.arange(many + 1) / (many + 1))
    variance = max(float(products[0] + 2 * products[1:].sum()), 0.05 * float(products[0])) / n
    scale = np.sqrt(max(own[0] * of_input[0], 1e-300))
    band = np.full(len(lags), NORMAL * np.sqrt(variance) / scale)
    # Neighbouring lags of a smooth input tell the same: the largest one, by Bonferroni.
    largest = float(np.abs(cross).max() ** 2 / max(variance, 1e-300))
    p_value = min(1.0, len(lags) * float(chi2.sf(largest, 1)))
    return ResidualTest(label, line.column, name, lags, cross / scale, band, p_value)


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
        found.append(whiteness(line, labels[line.recording]))
        found += [
            independence(line, labels[line.recording], name, values)
            for name, values in inputs[line.recording].items()
            if np.ptp(values[line.counts]) > 0
        ]
    return tuple(found)


def _shifted_product(given: NDArray[np.float64], residual: NDArray[np.float64], lag: int) -> float:
    """Σ residual(t + lag) given(t)."""
    if lag >= 0:
        return float(residual[lag:] @ given[: len(given) - lag])
    return float(residual[:lag] @ given[-lag:])
