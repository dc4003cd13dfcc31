"""Local polynomial smoothing whose window follows the signal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

ORDER = 3
WINDOWS = (7, 11, 15, 21, 31, 45, 65, 91, 131)
CONFIDENCE = 2.5
"""Half-width of the confidence intervals in standard deviations."""

Series = NDArray[np.float64]


def noise_level(values: Series) -> float:
    """Standard deviation of the white noise on a smooth signal, from its fourth differences.

    The median makes it deaf to the few samples around a kink. Zero for fewer than five samples.
    """
    if len(values) < 5:
        return 0.0
    fourth = np.diff(values, n=4)
    return float(1.4826 * np.median(np.abs(fourth - np.median(fourth))) / np.sqrt(70.0))


def smooth(values: Series, step: float, noise: float, derivative: int = 0) -> tuple[Series, Series]:
    """Smoothed signal or derivative by cubic Savitzky-Golay filters of locally chosen width.

    At each sample the widest window is taken whose estimate still agrees with those of all narrower ones
    (intersection of confidence intervals; Goldenshluger and Nemirovski 1997, Katkovnik 1999): wide where
    the signal is smooth, narrow at steps and stick-slip.

    Args:
        values: samples at a constant `step` [s].
        noise: standard deviation of the noise on `values`; 0 leaves the narrowest window.
        derivative: 0 for the signal, 1 for its rate.

    Returns:
        the estimate and its standard deviation, both at every sample; the samples themselves (or their
        differences) where there are fewer than the narrowest window holds.
    """
    if len(values) < WINDOWS[0]:
        raw = np.gradient(values, step) if derivative and len(values) > 1 else values * (derivative == 0)
        return raw.astype(float), np.full(len(values), noise * (np.sqrt(2.0) / step) ** derivative)
    lower: Series = np.full(values.shape, -np.inf)
    upper: Series = np.full(values.shape, np.inf)
    chosen, spread = np.zeros_like(values), np.zeros_like(values)
    agreeing = np.ones(values.shape, dtype=bool)
    for window in (w for w in WINDOWS if w <= len(values)):
        kernel = np.asarray(savgol_coeffs(window, ORDER, deriv=derivative, delta=step))
        deviation = noise * float(np.sqrt((kernel**2).sum()))
        estimate = np.asarray(savgol_filter(values, window, ORDER, deriv=derivative, delta=step))
        lower = np.maximum(lower, estimate - CONFIDENCE * deviation)
        upper = np.minimum(upper, estimate + CONFIDENCE * deviation)
        agreeing &= (lower <= upper) | (window == WINDOWS[0])
        chosen[agreeing], spread[agreeing] = estimate[agreeing], deviation
    return chosen, spread
