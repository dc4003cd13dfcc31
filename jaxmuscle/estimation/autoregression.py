"""Autoregressions: how noise remembers, in a few numbers, from series that may have gaps."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy.signal import lfilter, lfiltic

Line = NDArray[np.float64]

FEWEST = 20
"""Runs of readings without a gap from which a coefficient is estimated."""


@dataclasses.dataclass(frozen=True)
class Autoregression:
    r"""Stationary noise :math:`e_t = \sum_{i=1}^p a_i e_{t-i} + w_t` with white w.

    Attributes:
        reflections: partial autocorrelations k, each below 1 in size, from which the coefficients follow.
        variance: of e.
    """

    reflections: Line
    variance: float

    @property
    def coefficients(self) -> Line:
        """The coefficients a, by the recursion of Levinson and Durbin."""
        a = np.zeros(0)
        for k in self.reflections:
            a = np.append(a - k * a[::-1], k)
        return a

    @property
    def time(self) -> float:
        r"""Integrated autocorrelation time :math:`\sum_l ρ(l) = \prod_i (1 - k_i^2) / (1 - \sum_i a_i)^2`."""
        return float(np.prod(1 - self.reflections**2) / (1 - self.coefficients.sum()) ** 2)

    def covariances(self, count: int) -> Line:
        """Autocovariance γ at lags 0 … count - 1; its spectrum is positive at every frequency."""
        gamma, a, left = np.array([self.variance]), np.zeros(0), self.variance
        for k in self.reflections:
            gamma = np.append(gamma, k * left + a @ gamma[:0:-1])
            a, left = np.append(a - k * a[::-1], k), left * (1 - k**2)
        more = count - len(gamma)
        if more <= 0 or not len(a):
            return np.pad(gamma, (0, max(more, 0)))[:count]
        below = np.append(1.0, -a)
        state = lfiltic([1.0], below, gamma[:0:-1])
        return np.append(gamma, np.asarray(lfilter([1.0], below, np.zeros(more), zi=state)[0]))


def burg(
    parts: Float[np.ndarray, "parts n"],
    signs: Float[np.ndarray, " parts"],
    counts: Bool[np.ndarray, " n"],
    orders: range,
) -> Autoregression:
    r"""Autoregression of a series with gaps, its order among `orders` that with the least AIC.

    Every reflection coefficient is :math:`k_p = 2 \sum f_t b_{t-1} / \sum (f_t^2 + b_{t-1}^2)` with the
    forward and backward errors f and b of order p - 1, over all runs of p + 1 readings without a gap: Burg's
    method for segments, de Waele and Broersen, IEEE Trans. Signal Processing 48 (2000). Each is
    smaller than 1, however many readings are missing, which autocovariances divided by pairs do not ensure.
    Of orders, :math:`\sum_p N_p \ln(1 - k_p^2) + 2p` is least at the best, N the number of runs (Akaike),
    which for spectra is efficient where no order is true: Shibata, Annals of Statistics 9 (1981).

    Args:
        parts: series of which the sums of products add up; zero where `counts` is false.
        signs: with which they do.
        orders: from the least to the largest; fewer where there are fewer than 20 runs.
    """
    variance = float(signs @ (parts**2).sum(axis=1)) / max(int(counts.sum()), 1)
    forward, backward, whole = parts, parts, counts
    reflections: list[float] = []
    cost, best = 0.0, 0
    least = np.inf if orders.start else 0.0
    for order in range(1, orders.stop):
        whole = whole[1:] & counts[: len(counts) - order]
        runs = int(whole.sum())
        if runs < FEWEST:
            break
        ahead, behind = forward[:, 1:], backward[:, :-1]
        ahead, behind = np.where(whole, ahead, 0.0), np.where(whole, behind, 0.0)
        above = 2 * float(signs @ np.einsum("ij,ij->i", ahead, behind))
        below = float(signs @ (np.einsum("ij,ij->i", ahead, ahead) + np.einsum("ij,ij->i", behind, behind)))
        # A memory longer than the series cannot be told from it.
        k = float(np.clip(above / below, 1 / runs - 1, 1 - 1 / runs)) if below > 0 else 0.0
        forward, backward = ahead - k * behind, behind - k * ahead
        reflections.append(k)
        cost += runs * np.log1p(-(k**2)) + 2.0
        if order >= orders.start and cost < least:
            least, best = cost, order
    return Autoregression(np.array(reflections[:best]), max(variance, 0.0))
