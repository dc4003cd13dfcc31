"""Decimation of samples for drawing, such that no extreme and no gap is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def extremes(values: NDArray[np.float64], most: int) -> NDArray[np.int64]:
    """Rows of the smallest and the largest of `values` in each of `most / 2` stretches: no peak is lost."""
    if len(values) <= most:
        return np.arange(len(values))
    rows: list[int] = [0, len(values) - 1]
    for stretch in np.array_split(np.arange(len(values)), max(most // 2, 1)):
        finite = stretch[np.isfinite(values[stretch])]
        if len(finite) < len(stretch):
            # A gap stays a gap.
            rows.append(int(stretch[~np.isfinite(values[stretch])][0]))
        if len(finite):
            rows += [int(finite[np.argmin(values[finite])]), int(finite[np.argmax(values[finite])])]
    return np.unique(rows)
