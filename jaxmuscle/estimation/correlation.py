"""Autocorrelation of residuals, and what it does to the uncertainty of what was fitted to them."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from jaxmuscle.estimation.autoregression import Autoregression, burg
from jaxmuscle.estimation.lags import stride

Line = NDArray[np.float64]
Counts = Bool[np.ndarray, " n"]
Slopes = Float[np.ndarray, "k n"]
Matrix = Float[np.ndarray, "k k"]

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
    noise = _noise(given[:, rows], values[rows], counts[rows], inverse)
    return Memory(noise, max(noise.time, 1.0))


def coloured_meat(
    slopes: Slopes, values: Line, counts: Counts, inverse: Matrix | None = None
) -> Float[np.ndarray, "k k"]:
    r"""Covariance of the score Σ J e of coloured residuals: :math:`\sum_{t,s} J_t\,γ(t-s)\,J_s^T`.

    Morelli and Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", J.
    Guidance, Control, and Dynamics 20 (1997), equation 19. γ is that of an autoregression whose order the
    data choose, as in den Haan and Levin, "A practitioner's guide to robust covariance matrix estimation",
    Handbook of Statistics 15 (1997): positive semidefinite, with or without gaps.

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
    noise = _noise(slopes, values, counts, inverse)
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


def _noise(slopes: Slopes, values: Line, counts: Counts, inverse: Matrix | None) -> Autoregression:
    """Noise that leaves such residuals when so much is fitted to it."""
    residual, number = np.where(counts, values, 0.0)[None], int(counts.sum())
    noise = burg(residual, np.ones(1), counts, range(round(number ** (1 / 3)) + 1))
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
