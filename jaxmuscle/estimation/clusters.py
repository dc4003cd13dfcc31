"""Scores of stretches of the recordings that are taken for independent of each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.series import Series

PARTS = 20
"""Stretches into which a window is cut that is the only one."""

Values = NDArray[np.float64]
Rows = NDArray[np.int64]


def window_scores(lines: Sequence[Series], errors: Sequence[Values]) -> Float[np.ndarray, "stretches k"]:
    """Score Σ J ψ of every window, or of every part of the only one: all columns of a recording together.

    Args:
        errors: ψ of the residuals of each line.
    """
    stretches = [line.window for line in lines]
    windows = {(line.recording, int(i)) for line in lines for i in np.unique(line.window[line.window >= 0])}
    if len(windows) == 1:
        stretches = _parts(stretches)
    totals: dict[tuple[int, int], Values] = {}
    for line, stretch, psi in zip(lines, stretches, errors, strict=True):
        for number in np.unique(stretch[stretch >= 0]).tolist():
            inside, key = stretch == number, (line.recording, number)
            totals[key] = totals.get(key, np.zeros(len(line.slopes))) + line.slopes[:, inside] @ psi[inside]
    return np.array(list(totals.values())).reshape(-1, len(lines[0].slopes))


def _parts(windows: Sequence[Rows]) -> list[Rows]:
    """For each line the numbers of the parts of the only window, -1 outside."""
    rows = np.unique(np.concatenate([np.flatnonzero(window >= 0) for window in windows]))
    length = rows[-1] + 1 - rows[0]
    return [
        np.where(window >= 0, (np.arange(len(window)) - rows[0]) * PARTS // length, -1) for window in windows
    ]
