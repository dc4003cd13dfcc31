"""Adaptive Savitzky-Golay smoothing: local polynomials whose window follows the signal; noise levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

ORDER = 3
WINDOWS = (7, 11, 15, 21, 31, 45, 65, 91, 131)
CONFIDENCE = 2.5
"""Half-width of the confidence intervals in standard deviations."""
PAST_ORDER, PAST_WINDOWS, PAST_CONFIDENCE = 2, (4, 6, 9, 13, 19, 28, 40, 57, 81, 115), 1.7
"""The same for :func:`rate_from_past`. A cubic would leave twice the noise at its last sample.

Half-widths of 0.5 to 2.5 were tried on sines of 4 and 20 rad/s and on filtered steps, at 100 Hz with noise of
0.0001 to 0.01.
"""

LEVELS = 32
"""Fewest values that make a signal a quantised one."""
STAYS = 0.1
"""Least part of these that the signal has to show twice in a row."""

Series = NDArray[np.float64]
Widths = NDArray[np.int64]


def noise_level(values: Series) -> float:
    r"""Standard deviation of the white noise on a smooth signal, from its fourth differences.

    The median makes it deaf to the few samples around a kink. Never below :math:`q/\sqrt{12}`, the deviation
    of an error that is uniform over one step q of the converter (Widrow and Kollár, Quantization Noise, 2008,
    chapter 1): a slow signal that is read in steps has differences of zero. Zero for fewer than five samples.
    """
    if len(values) < 5:
        return 0.0
    fourth = np.diff(values, n=4)
    spread = 1.4826 * np.median(np.abs(fourth - np.median(fourth))) / np.sqrt(70.0)
    return float(max(spread, quantisation_step(values) / np.sqrt(12.0)))


def quantisation_step(values: Series) -> float:
    """Step q of the converter that a signal was read with; zero where none is seen.

    The smallest spacing of the values that occur, if most neighbours are that far apart (a quarter more or
    less, for values that were rounded once more when they were written), there are at least `LEVELS` of them,
    and the signal stays on a part of them from one sample to the next: equal steps alone can be those of a
    ramp without noise. A staircase of fewer levels is taken for what the signal really did.
    """
    levels = np.unique(values)
    if len(levels) < LEVELS:
        return 0.0
    stays = np.unique(values[1:][np.diff(values) == 0])
    spacings = np.diff(levels)
    smallest = np.quantile(spacings, 0.05)
    single = spacings[(spacings > 0.75 * smallest) & (spacings < 1.25 * smallest)]
    if len(stays) < STAYS * len(levels) or 2 * len(single) < len(spacings):
        return 0.0
    return float(np.median(single))


def smooth(
    values: Series, step: float, noise: float, derivative: int = 0, twice: bool = False
) -> tuple[Series, Series]:
    """Smoothed signal or derivative by cubic Savitzky-Golay filters of locally chosen width.

    At each sample the widest window is taken whose estimate still agrees with those of all narrower ones
    (intersection of confidence intervals; Goldenshluger and Nemirovski 1997, Katkovnik 1999): wide where
    the signal is smooth, narrow at steps and stick-slip. As wide as that, it cuts peaks: by as much as the
    noise that is left, and always inwards.

    Args:
        values: samples at a constant `step` [s].
        noise: standard deviation of the noise on `values`; 0 leaves the narrowest window.
        derivative: 0 for the signal, 1 for its rate.
        twice: what is cut of a signal is in the residuals: smooth them in the same windows and put that back
            (twicing; Tukey, Exploratory Data Analysis, 1977, chapter 16). Rates stay as they are: it would
            add more to their noise than it takes off their error.

    Returns:
        the estimate and its standard deviation, both at every sample; the samples themselves (or their
        differences) where there are fewer than the narrowest window holds.
    """
    if len(values) < WINDOWS[0]:
        raw = np.gradient(values, step) if derivative and len(values) > 1 else values * (derivative == 0)
        return raw.astype(float), np.full(len(values), noise * (np.sqrt(2.0) / step) ** derivative)
    estimate, widths = _widest(values, step, noise, derivative)
    left, spread = values - estimate, np.zeros_like(values)
    for window in np.unique(widths):
        here, kernel = widths == window, savgol_coeffs(window, ORDER, deriv=derivative, delta=step)
        if twice and derivative == 0:
            estimate[here] += np.asarray(savgol_filter(left, window, ORDER))[here]
            kernel = 2 * np.pad(kernel, window // 2) - np.convolve(kernel, kernel)
        spread[here] = noise * float(np.sqrt((kernel**2).sum()))
    return estimate, spread


def _widest(values: Series, step: float, noise: float, derivative: int) -> tuple[Series, Widths]:
    """The estimate in the widest window that agrees with all narrower ones, and that window, everywhere."""
    lower: Series = np.full(values.shape, -np.inf)
    upper: Series = np.full(values.shape, np.inf)
    chosen, widths = np.zeros_like(values), np.full(values.shape, WINDOWS[0])
    agreeing = np.ones(values.shape, dtype=bool)
    for window in (w for w in WINDOWS if w <= len(values)):
        kernel = savgol_coeffs(window, ORDER, deriv=derivative, delta=step)
        reach = CONFIDENCE * noise * float(np.sqrt((kernel**2).sum()))
        estimate = np.asarray(savgol_filter(values, window, ORDER, deriv=derivative, delta=step))
        lower, upper = np.maximum(lower, estimate - reach), np.minimum(upper, estimate + reach)
        agreeing &= (lower <= upper) | (window == WINDOWS[0])
        chosen[agreeing], widths[agreeing] = estimate[agreeing], window
    return chosen, widths


def rate_from_past(values: Series, step: float, noise: float) -> tuple[Series, Series]:
    """Rate of a signal at every sample as the samples up to then tell it: what one knows who predicts.

    As of :func:`smooth`, by parabolas that end at the sample: the widest window whose estimate still agrees
    with those of all narrower ones. It lags where a motion changes, and has several times the error of a rate
    that is told from both sides.

    Args:
        values: samples at a constant `step` [s].
        noise: standard deviation of the noise on `values`.

    Returns:
        the rate and its standard deviation, both at every sample: where fewer samples came before than the
        narrowest window holds, from the last two (the first sample has the rate of the second).
    """
    count = len(values)
    if count < 2:
        return np.zeros(count), np.full(count, noise / step)
    rate: Series = np.diff(values, prepend=2 * values[0] - values[1]) / step
    spread: Series = np.full(count, noise * np.sqrt(2.0) / step)
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    agreeing = np.ones(count, dtype=bool)
    for window in (w for w in PAST_WINDOWS if w <= count):
        kernel = savgol_coeffs(window, PAST_ORDER, deriv=1, delta=step, pos=window - 1, use="dot")
        found, deviation = np.full(count, np.nan), noise * float(np.sqrt((kernel**2).sum()))
        found[window - 1 :] = np.convolve(values, kernel[::-1], "valid")
        lower = np.fmax(lower, found - PAST_CONFIDENCE * deviation)
        upper = np.fmin(upper, found + PAST_CONFIDENCE * deviation)
        agreeing &= np.isfinite(found) & ((lower <= upper) | (window == PAST_WINDOWS[0]))
        rate[agreeing], spread[agreeing] = found[agreeing], deviation
    return rate, spread
