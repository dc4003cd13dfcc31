"""Coloured noise: autocovariance of series with gaps, autoregressions (Burg), and what correlated
residuals do to the covariance of fitted parameters.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy.signal import fftconvolve, lfilter, lfiltic

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


Slopes = Float[np.ndarray, "k n"]
Matrix = Float[np.ndarray, "k k"]

ENVELOPE, SPECTRUM = 1 / 3, 1 / 2
"""Power of the number of readings up to which an autoregression's order goes, where one time stands for all
directions, and where slopes meet the spectrum.

A low order follows how fast the correlation falls; a higher one knows that an error which swings with the
motion has nothing at frequency zero, and would call it forgotten at once (a sine of 250 samples beside noise:
times of 262 and 4). White noise and a slow one together need the higher one: where 2000 readings remembered
200 of them standard deviations of slow slopes were 0.5 of the true ones with the cube root, 0.7 with the
square root; where they remembered 5 of them, 0.97 and 0.98.
"""
ROUNDS = 3
"""How often the noise is estimated anew with what the fit took from it."""
SEEN = 1e-11
"""Eigenvalue of the products of scaled slopes, relative to the largest, from which a direction is seen."""
NEGLIGIBLE = 1e-3
"""Part of the noise that a fit may have taken without being given back."""


@dataclasses.dataclass(frozen=True)
class Memory:
    """How long residuals remember: the noise that they are, and its integrated time [samples].

    Where readings come regularly but not on every row, a sample is a reading.
    """

    noise: Autoregression
    time: float


def memory(
    values: Line, counts: Counts, slopes: Slopes | None = None, inverse: Matrix | None = None
) -> Memory:
    r"""Integrated autocorrelation time :math:`τ = 1 + 2 \sum_l ρ(l)`, at least 1, of the noise they are.

    Sokal, "Monte Carlo methods in statistical mechanics" (1997), section 3. White residuals have τ = 1; n
    residuals with time τ tell as much about a mean as n/τ independent ones. `slopes`, `inverse`: see
    `coloured_meat`; without them as if nothing had been fitted.
    """
    rows = _rows(counts)
    given = np.zeros((0, len(values))) if slopes is None else slopes
    noise = _noise(given[:, rows], values[rows], counts[rows], inverse, ENVELOPE)
    return Memory(noise, max(noise.time, 1.0))


def coloured_meat(
    slopes: Slopes, values: Line, counts: Counts, inverse: Matrix | None = None
) -> Float[np.ndarray, "k k"]:
    r"""Covariance of the score Σ J e of coloured residuals: :math:`\sum_{t,s} J_t\,γ(t-s)\,J_s^T`.

    Morelli and Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", J.
    Guidance, Control, and Dynamics 20 (1997), equation 19. γ is that of an autoregression whose order the
    data choose (up to :data:`SPECTRUM`), as in den Haan and Levin, "A practitioner's guide to robust
    covariance matrix estimation", Handbook of Statistics 15 (1997): positive semidefinite, with or without
    gaps.

    Residuals are less than the noise by what the fit took from it, most at the low frequencies that slow
    slopes J can follow: of noise with covariance Γ it leaves R Γ R, :math:`R = (1 - J^T A^{-1} J)^{1/2}`
    (where J alone makes A, the projection 1 - JᵀA⁻¹J). Γ - R Γ R by the noise found so far is added to the
    products of the residuals, and the noise estimated anew: Worsley and others, "A general statistical
    analysis for fMRI data", NeuroImage 15 (2002), there by autocovariances.

    Args:
        slopes, values: zero on rows that do not count.
        inverse: of the information matrix A of all that was fitted together; `None` if this was all.
    """
    rows = _rows(counts)
    slopes, values, counts = slopes[:, rows], values[rows], counts[rows]
    noise = _noise(slopes, values, counts, inverse, SPECTRUM)
    return _through(noise, slopes) @ slopes.T


def _rows(counts: Counts) -> slice:
    """The rows on which a sensor slower than the clock is read; all of them otherwise."""
    step = stride(counts)
    return slice(int(np.argmax(counts)) % step, None, step)


def _through(noise: Autoregression, slopes: Slopes) -> Slopes:
    """Rows times the covariance matrix Γ of the noise."""
    count = slopes.shape[1]
    gamma = noise.covariances(count)
    both = np.concatenate([gamma[:0:-1], gamma])[None]
    return fftconvolve(slopes, both, axes=1)[:, count - 1 : 2 * count - 1]


def _noise(
    slopes: Slopes, values: Line, counts: Counts, inverse: Matrix | None, growth: float
) -> Autoregression:
    """Noise that leaves such residuals when so much is fitted to it, of an order up to nᵍʳᵒʷᵗʰ."""
    residual, number = np.where(counts, values, 0.0)[None], int(counts.sum())
    noise = burg(residual, np.ones(1), counts, range(round(number**growth) + 1))
    followed, part = _followed(slopes, inverse)
    order = len(noise.reflections)
    # Of residuals that are zero nothing was taken; the two halves of it cancel to rounding only.
    for _ in range(ROUNDS if len(part) and noise.variance > 0 else 0):
        taken, signs = _taken(noise, followed, part, counts)
        if signs @ (taken**2).sum(axis=1) <= NEGLIGIBLE * number * noise.variance:
            break
        both = np.concatenate([residual, taken]), np.concatenate([np.ones(1), signs])
        noise = burg(*both, counts, range(order, order + 1))
    return noise


def _followed(slopes: Slopes, inverse: Matrix | None) -> tuple[Slopes, Line]:
    """Orthonormal directions that a fit can follow, and the part of noise in each that it does."""
    size = np.linalg.norm(slopes, axis=1)
    size = np.where(size > 0, size, 1.0)
    scaled = slopes / size[:, None]
    values, across = np.linalg.eigh(scaled @ scaled.T)
    seen = values > SEEN * values.max(initial=0.0)
    root, across = np.sqrt(values[seen]), across[:, seen]
    along = (across / root).T @ scaled
    if inverse is None:
        return along, np.ones(len(along))
    mixing = size[:, None] * across * root
    part, turned = np.linalg.eigh(mixing.T @ inverse @ mixing)
    return turned.T @ along, np.clip(part, 0.0, 1.0)


def _taken(noise: Autoregression, followed: Slopes, part: Line, counts: Counts) -> tuple[Slopes, Line]:
    """Γ - R Γ R as series of which the products add up, and the signs with which they do.

    With R = 1 - DᵀV it is DᵀB + BᵀD, B = VΓ - V Γ Vᵀ D/2: half the squares of D + B less those of D - B.
    """
    along = (1 - np.sqrt(1 - part))[:, None] * followed
    through = _through(noise, followed) * counts
    beside = through - followed @ through.T @ along / 2
    # Of the same size, so that the two hardly cancel.
    size = np.sqrt(max(noise.variance, 1e-300))
    along, beside = along * size, beside / size
    both = np.concatenate([along + beside, along - beside]) / np.sqrt(2)
    return both, np.repeat([1.0, -1.0], len(part))
