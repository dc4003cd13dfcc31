"""Autocorrelation of residuals, and what it does to the uncertainty of what was fitted to them."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Line = NDArray[np.float64]

ENOUGH_TIMES = 5.0
"""Autocorrelation times over which an autocorrelation is summed (Sokal 1997)."""
LONGEST_PART = 0.1
"""Part of a series over which its autocorrelation is looked at."""


@dataclasses.dataclass(frozen=True)
class Memory:
    """How long residuals remember: autocorrelation by lag from 0 on, and its integrated time [samples]."""

    autocorrelation: Line
    time: float
    lags: int


def autocovariance(values: Line, counts: Bool[NDArray[np.bool_], " n"], lags: int) -> Line:
    """Mean of e(t) e(t+l) over all rows that count, l = 0 … lags.

    Divided by the number of samples, not of pairs: that keeps every spectrum of it above zero.
    """
    lags = min(lags, len(values) - 1)
    line = np.where(counts, values, 0.0)
    full = fftconvolve(line, line[::-1])[len(line) - 1 :]
    return full[: lags + 1] / max(int(counts.sum()), 1)


def memory(values: Line, counts: Bool[NDArray[np.bool_], " n"]) -> Memory:
    r"""Integrated autocorrelation time :math:`τ = 1 + 2 \sum_{l ≤ L} ρ(l)`, L the first lag ≥ 5 τ.

    Sokal, "Monte Carlo methods in statistical mechanics" (1997), section 3. White residuals have τ = 1;
    n residuals with time τ tell as much as n/τ independent ones.
    """
    longest = max(int(LONGEST_PART * counts.sum()), 1)
    covariance = autocovariance(values, counts, longest)
    if not covariance[0] > 0:
        return Memory(np.ones(1), 1.0, 0)
    rho = covariance / covariance[0]
    sums = 2 * np.cumsum(rho) - 1
    enough = np.flatnonzero(np.arange(len(rho)) >= ENOUGH_TIMES * np.maximum(sums, 1.0))
    last = int(enough[0]) if enough.size else len(rho) - 1
    return Memory(rho[: last + 1], float(max(sums[last], 1.0)), last)


def coloured_meat(
    slopes: Float[NDArray, "k n"], values: Line, counts: Bool[NDArray[np.bool_], " n"]
) -> Float[NDArray, "k k"]:
    r"""Covariance of the score Σ J e of coloured residuals: :math:`\sum_{t,s} J_t\,γ(t-s)\,J_s^T`.

    Morelli and Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", J.
    Guidance, Control, and Dynamics 20 (1997), equation 19. γ is the sample autocovariance up to twice the lag
    that its autocorrelation time asks for, tapered linearly (Bartlett), which keeps the result positive.
    """
    found = memory(values, counts)
    lags = min(2 * found.lags, len(values) - 1)
    gamma = autocovariance(values, counts, lags) * (1 - np.arange(lags + 1) / (lags + 1))
    kernel = np.concatenate([gamma[:0:-1], gamma])
    spread = fftconvolve(slopes, kernel[None], mode="full", axes=1)[:, lags : lags + slopes.shape[1]]
    return spread @ slopes.T
