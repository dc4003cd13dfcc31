"""Outliers of a sensor: single readings that no motion of the machine can have made; and all bad rows."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.estimation.missing_data import Mask, noise_beside_gaps, usable
from jaxmuscle.recordings.card import actuator_from_card
from jaxmuscle.recordings.recording import Recording

Values = NDArray[np.float64]
Rows = NDArray[np.bool_]

BESIDE = 3
"""Readings on each side that a reading is held against: two in a row may be wrong."""
FAR = 8.0
"""Deviation from their line, in units of their spread or of the noise, from which a reading is an outlier.

Of 10^11 readings with normal noise one goes so far by chance.
"""
NORMAL = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""


def outliers(values: Values, noise: float, breaks: tuple[int, ...] = ()) -> Rows:
    """Readings that stand out from those beside them.

    A Hampel identifier over a moving window (Davies and Gather, J. American Statistical Association 88
    (1993); Pearson, IEEE Trans. Control Systems Technology 10 (2002)), about a line in place of a constant:
    that through the median of the three readings before and of the three behind. An outlier is further from
    it than eight times their spread, which is their median absolute deviation in units of the normal one, or
    the noise if that is larger. Where the signal jumps or turns, readings are spread, and none stands out.

    Args:
        values: readings; NaN where there is none.
        noise: standard deviation of the sensor; without any (0), nothing is called an outlier.
        breaks: rows at which a new run begins.
    """
    found = np.zeros(len(values), dtype=bool)
    there = np.isfinite(values)
    for begin, end in itertools.pairwise((0, *breaks, len(values))):
        own = begin + np.flatnonzero(there[begin:end])
        if noise > 0 and len(own) > 2 * BESIDE:
            found[own] = _far(values[own], noise)
    return found


def _far(line: Values, noise: float) -> Rows:
    """Of a run without gaps. At its ends a jump is on one side only: nothing there is called an outlier."""
    wide = np.lib.stride_tricks.sliding_window_view(line, 2 * BESIDE + 1)
    before, after = (np.median(side, axis=1) for side in (wide[:, :BESIDE], wide[:, BESIDE + 1 :]))
    places = np.arange(-BESIDE, BESIDE + 1)
    slope = (after - before) / (BESIDE + 1)
    deviation = np.abs(wide - 0.5 * (before + after)[:, None] - slope[:, None] * places)
    spread = NORMAL * np.median(np.delete(deviation, BESIDE, axis=1), axis=1)
    return np.pad(deviation[:, BESIDE] > FAR * np.maximum(spread, noise), BESIDE)


def sensor_outliers(
    actuator: AbstractActuator, recording: Recording, noise: Mapping[str, float]
) -> dict[str, Rows]:
    """Column of each sensor that has outliers → their rows.

    Args:
        noise: column → standard deviation of its sensor; of others what their readings show.
    """
    found = {}
    for column in measured_columns(actuator):
        values = recording.columns[column]
        size = noise.get(column) or noise_beside_gaps(values, ~np.isfinite(values), recording.breaks)
        rows = outliers(values, size, recording.breaks)
        if rows.any():
            found[column] = rows
    return found


def bad_rows(recording: Recording, ignored: Mask | None) -> dict[str, Rows]:
    """Column → rows that do not count: those to be ignored, those that cannot be used, the sensor's outliers.

    Raises:
        InputError: too little is left (:func:`~jaxmuscle.estimation.missing_data.usable`).
    """
    actuator = actuator_from_card(recording.card)
    good = usable(actuator, recording, ignored).good
    wrong = sensor_outliers(actuator, recording, recording.card.noise)
    return {column: ~rows | wrong.get(column, False) for column, rows in good.items()}
