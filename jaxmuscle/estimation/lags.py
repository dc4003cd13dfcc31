"""Pairs of readings that lie so many samples apart, where not every row counts."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Line = NDArray[np.float64]
Counts = Bool[np.ndarray, " n"]


def pairs(counts: Counts, lags: int) -> NDArray[np.int64]:
    """How many pairs of rows l = 0 … lags apart both count."""
    line = counts.astype(float)
    found = fftconvolve(line, line[::-1])[len(line) - 1 :]
    return np.rint(found[: lags + 1]).astype(np.int64)


def stride(counts: Counts) -> int:
    """Largest step of which all distances between rows that count are multiples; 1 for fewer than two."""
    rows = np.flatnonzero(counts)
    return int(np.gcd.reduce(np.diff(rows))) if len(rows) > 1 else 1


def autocovariance(values: Line, counts: Counts, lags: int) -> Line:
    """Mean of e(t) e(t+l) over the pairs of rows that both count, l = 0 … lags; zero where there is none."""
    lags = min(lags, len(values) - 1)
    line = np.where(counts, values, 0.0)
    full = fftconvolve(line, line[::-1])[len(line) - 1 :]
    return full[: lags + 1] / np.maximum(pairs(counts, lags), 1)
