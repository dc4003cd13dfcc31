"""Model comparison on held-out windows: does one model predict them better than another?"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike, NDArray
from scipy import stats

TELLING = float(np.log(3.0))
"""Loss above which a block tells two models apart: a mean square of twice the noise."""

Blocks = Int[np.ndarray, "windows samples"]

NOISE = float(np.log(2.0))
"""Loss of a block that only noise is left in."""

Losses = Float[np.ndarray, " blocks"]


def blocks(windows: int, samples: int, period: int) -> Blocks:
    """Number of the block of each sample, when every window is cut after `period` samples, and again."""
    within = np.arange(samples) // period
    return np.arange(windows)[:, None] * (within[-1] + 1) + within


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Comparison of two models on data that neither was fitted to.

    Attributes:
        gain: part of the excess error that the second model removes; negative if it is worse.
        p_value: one-sided Wilcoxon signed-rank test over the blocks in which either model misses.
        loss: geometric mean over blocks of 1 + the mean square of the weighted residuals, less one; 1 is
            what the sensors' noise leaves.
    """

    gain: float
    p_value: float
    loss: float


def block_losses(
    residuals: Mapping[str, ArrayLike], weights: Mapping[str, ArrayLike], block: Blocks, judged: NDArray
) -> Losses:
    """log(1 + mean square) of the weighted residuals of each judged block, output by output.

    The logarithm is that of a heavy-tailed likelihood (Student with one degree of freedom a block): a
    single stretch that calls for extrapolation, with an error of hundreds of standard deviations under
    any model, must not decide between them.

    Args:
        block: number of the block that each sample belongs to; `judged`: numbers of the blocks to judge.
    """
    losses = []
    for output, values in residuals.items():
        there = np.asarray(weights[output]) > 0
        each = np.broadcast_to(block.reshape(block.shape + (1,) * (there.ndim - 2)), there.shape)[there]
        squares = np.asarray(values)[there] ** 2
        total = np.bincount(each, squares, minlength=judged.max() + 1)
        count = np.bincount(each, minlength=judged.max() + 1)
        mean = total[judged] / np.maximum(count[judged], 1)
        losses.append(np.where(count[judged] > 0, np.log1p(mean), NOISE))
    return np.concatenate(losses)


def compare(before: Losses, after: Losses) -> Evidence:
    """Evidence for `after` over `before`, block by block."""
    loss = float(np.expm1(after.mean()))
    telling = np.maximum(before, after) > TELLING
    difference = (before - after)[telling]
    informative = difference[np.abs(difference) > 1e-9]
    if len(informative) == 0:
        return Evidence(0.0, 1.0, loss)
    p_value = float(stats.wilcoxon(informative, alternative="greater").pvalue)  # pyright: ignore
    excess = (before[telling] - NOISE).sum()
    return Evidence(float(difference.sum() / excess) if excess > 0 else 0.0, p_value, loss)
