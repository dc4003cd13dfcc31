"""Gaps in a column, bridged by the readings beside them; the noise of a column that has gaps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.recordings.smooth import quantisation_step

Values = NDArray[np.float64]
Rows = NDArray[np.bool_]

LONGEST_BRIDGE = 20
"""Samples of a measured state in a row that are bridged by a curve; a longer gap ends a window."""
BESIDE, SHARE = 2, 4
"""Readings on each side that a curve goes by: two, and one more for so many samples of the gap."""
OVERSHOOT = 1.0
"""How far a curve may go beyond these readings, in parts of their range: the top of a wave goes up to 0.8."""
STENCILS = 100
"""Stencils from which the noise can be told to a tenth."""


def bridged(values: Values, bad: Rows, breaks: Sequence[int] = ()) -> Values:
    """The column with each gap bridged by a cubic through the readings beside it, least squares if there are
    more than two on a side.

    A straight line would cut the tops off, all to the same side: a bias in what depends on the column. Longer
    gaps than `LONGEST_BRIDGE` are bridged by a line, which nothing depends on, and at its ends a run is held.
    A break is not bridged across.
    """
    filled, rows = values.astype(np.float64), np.arange(len(values))
    good = np.flatnonzero(~bad)
    filled[bad] = np.interp(rows[bad], good, values[good]) if good.size else 0.0
    for begin, end in itertools.pairwise((0, *breaks, len(values))):
        own = begin + np.flatnonzero(~bad[begin:end])
        if not own.size:
            continue
        outside = np.concatenate([np.arange(begin, own[0]), np.arange(own[-1] + 1, end)])
        filled[outside] = np.interp(outside, own, values[own])
        for before in np.flatnonzero(np.diff(own) > 1):
            gap = np.arange(own[before] + 1, own[before + 1])
            filled[gap] = _across(values, own, int(before), gap)
    return filled


def _across(values: Values, own: NDArray[np.intp], before: int, gap: NDArray[np.intp]) -> Values:
    """The curve across one gap, which lies behind reading number `before` of a run's `own`."""
    many = BESIDE + len(gap) // SHARE if len(gap) <= LONGEST_BRIDGE else 1
    many = min(many, before + 1, len(own) - before - 1)
    beside = own[before + 1 - many : before + 1 + many]
    middle, size = gap.mean(), 0.5 * float(np.ptp(beside))
    degree = min(3, 2 * many - 1)
    powers = np.vander((beside - middle) / size, degree + 1)
    curve = np.vander((gap - middle) / size, degree + 1) @ np.linalg.lstsq(powers, values[beside])[0]
    low, high = values[beside].min(), values[beside].max()
    more = OVERSHOOT * (high - low)
    return np.clip(curve, low - more, high + more).astype(np.float64)


def noise_beside_gaps(values: Values, bad: Rows, breaks: Sequence[int] = ()) -> float:
    """Standard deviation of the white noise on a smooth signal, from its readings only.

    By fourth differences, as :func:`jaxmuscle.recordings.smooth.noise_level`, where five readings follow each
    other; bridged gaps are smoother than any reading and would make little of the noise. Where these are too
    few, by fourth divided differences of five readings with gaps between them, the narrowest first, each in
    units of its own standard deviation. Not below that of a converter's steps. Zero for fewer than five
    readings.
    """
    signs, widths = [np.zeros(0)], [np.zeros(0)]
    for begin, end in itertools.pairwise((0, *breaks, len(values))):
        own = begin + np.flatnonzero(~bad[begin:end])
        if len(own) < 5:
            continue
        at = np.lib.stride_tricks.sliding_window_view(own, 5).astype(np.float64)
        apart = at[:, :, None] - at[:, None, :] + np.eye(5)
        weights = 1 / apart.prod(axis=2)
        size = np.linalg.norm(weights, axis=1)
        signs.append((weights * values[at.astype(np.intp)]).sum(axis=1) / size)
        widths.append(1 / size)
    differences, width = np.concatenate(signs), np.concatenate(widths)
    if not len(width):
        return 0.0
    widest = np.sort(width)[min(STENCILS, len(width)) - 1]
    kept = differences[width <= widest * (1 + 1e-9)]
    spread = 1.4826 * np.median(np.abs(kept - np.median(kept)))
    return float(max(spread, quantisation_step(values[~bad]) / np.sqrt(12.0)))
