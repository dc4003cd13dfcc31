"""Does one model predict unseen windows better than another?"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from scipy import stats

from jaxmuscle.fitting.problem import Residuals

BLOCKS = 4
"""Parts into which a window is cut for the test: neighbouring samples are not independent."""

NOISE = float(np.log(2.0))
"""Loss of a block that only noise is left in."""

Losses = Float[NDArray[np.float64], "windows blocks"]


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Comparison of two models on data that neither was fitted to.

    Attributes:
        gain: part of the excess error that the second model removes; negative if it is worse.
        p_value: one-sided Wilcoxon signed-rank test over blocks of windows.
        loss: geometric mean over blocks of 1 + the mean square of the weighted residuals, less one; 1 is
            what the sensors' noise leaves.
    """

    gain: float
    p_value: float
    loss: float


def block_losses(residuals: Residuals, weights: Residuals, held: NDArray[np.bool_]) -> Losses:
    """log(1 + mean square) of the weighted residuals of each block of each window in `held`, by output.

    The logarithm is that of a heavy-tailed likelihood (Student with one degree of freedom a block): a
    single window that calls for extrapolation, with an error of hundreds of standard deviations under
    any model, must not decide between them.
    """
    columns = []
    for output, values in residuals.items():
        weighted = np.asarray(weights[output])[held] > 0
        squares = np.where(weighted, np.asarray(values)[held] ** 2, 0.0)
        for part, there in zip(
            np.array_split(squares, BLOCKS, axis=1), np.array_split(weighted, BLOCKS, axis=1), strict=True
        ):
            count = there.reshape(len(there), -1).sum(1)
            mean = part.reshape(len(part), -1).sum(1) / np.maximum(count, 1)
            columns.append(np.where(count > 0, np.log1p(mean), NOISE))
    return np.stack(columns, axis=1)


def compare(before: Losses, after: Losses) -> Evidence:
    """Evidence for `after` over `before`, block by block."""
    difference = (before - after).ravel()
    loss = float(np.expm1(after.mean()))
    informative = difference[np.abs(difference) > 1e-9]
    if len(informative) == 0:
        return Evidence(0.0, 1.0, loss)
    p_value = float(stats.wilcoxon(informative, alternative="greater").pvalue)  # pyright: ignore
    excess = (before - NOISE).sum()
    return Evidence(float(difference.sum() / excess) if excess > 0 else 0.0, p_value, loss)
