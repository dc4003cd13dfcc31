"""Evidence on windows that no fit has seen: losses block by block, and a sign-flip test of several models
against one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata

from jaxmuscle.estimation.losses import SQUARES, Loss

TELLING = float(np.log(3.0))
"""Loss above which a block tells two models apart: a mean square of twice the noise."""

Blocks = Int[np.ndarray, "windows samples"]

NOISE = float(np.log(2.0))
"""Loss of a block that only noise is left in."""

Losses = Float[np.ndarray, "outputs blocks"]
"""Loss of every block, in the order of time."""


def blocks(windows: int, samples: int, period: int) -> Blocks:
    """Number of the block of each sample, when every window is cut after `period` samples, and again."""
    within = np.arange(samples) // period
    return np.arange(windows)[:, None] * (within[-1] + 1) + within


SIGN_FLIPS, LIKELIHOOD_RATIO = "sign flips", "likelihood ratio"
LARGEST_P = {SIGN_FLIPS: 0.01, LIKELIHOOD_RATIO: 1e-4}
"""Test → p-value, of all candidates together, up to which the first effect is added; half of that for the
second, a quarter for the third. A likelihood ratio has to be clearer: its distribution is approximate."""
LEAST_GAIN = {SIGN_FLIPS: 0.05, LIKELIHOOD_RATIO: 0.3}
"""Test → part of the excess error on unseen windows that an effect must remove. Over a few stretches chance
removes more, and a likelihood ratio says only that something is missing, not that it is this."""
HALVED = 2 * float(np.log(2.0))
"""Fall of the loss in a typical block that does instead: an error that is halved, of whatever size."""
TOLD_APART = 0.05
"""p-value below which the best candidate is told apart from another."""
OUTCOMES = 10
"""Outcomes of the sign-flip test at least that have to be able to support an effect."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Comparison of two models on data that neither was fitted to.

    Attributes:
        gain: part of the excess error that the second model removes; negative if it is worse.
        p_value: one-sided, for all models that were compared together; 1 where nothing was tested.
        loss: geometric mean over blocks of 1 + the mean square of the weighted residuals, less one; 1 is
            what the sensors' noise leaves.
        stretches: how many stretches of the recording tell the two models apart.
        test: which test the p-value is of, :data:`SIGN_FLIPS` or :data:`LIKELIHOOD_RATIO`.
        fall: by how much the loss falls in a typical block of those in which either model misses.
    """

    gain: float
    p_value: float
    loss: float
    stretches: int = 0
    test: str = SIGN_FLIPS
    fall: float = 0.0

    def supports(self, found: int) -> bool:
        """Whether it is enough to add an effect, when so many were found before.

        Every round is another chance to be misled: each may spend half of what the one before could, so that
        all of them together stay below twice the first one's limit.
        """
        enough = self.gain >= LEAST_GAIN[self.test] or self.fall >= HALVED
        return enough and self.p_value <= LARGEST_P[self.test] / 2**found

    def too_few_stretches(self, found: int, times: int = 1) -> bool:
        """Whether fewer than :data:`OUTCOMES` outcomes of the sign-flip test could support an effect.

        Args:
            times: what its p-value is multiplied by, as so many others were tried.
        """
        return OUTCOMES * times * 0.5**self.stretches > LARGEST_P[SIGN_FLIPS] / 2**found


def block_losses(
    residuals: Mapping[str, ArrayLike], weights: Mapping[str, ArrayLike], block: Blocks, judged: NDArray
) -> Losses:
    """log(1 + mean square) of the weighted residuals of each judged block, a row for each output.

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
    return np.stack(losses)


def telling_excess(
    residuals: Mapping[str, ArrayLike],
    weights: Mapping[str, ArrayLike],
    block: Blocks,
    factors: Mapping[str, ArrayLike] | None = None,
    loss: Loss = SQUARES,
) -> float:
    """Sum of squared weighted residuals beyond what noise leaves, over the blocks in which a model misses.

    What all blocks leave together says less: noise declared a hundredth too large hides, over the many
    readings of one output, all that is missing of another.

    Args:
        factors: output → what its weights are multiplied by (one for each of its columns), if not by 1.
        loss: whose double takes the place of the squares.
    """
    found = 0.0
    for output, values in residuals.items():
        there = np.asarray(weights[output]) > 0
        shape = (*there.shape[:2], -1)
        left, count = (np.where(there, each, 0.0).reshape(shape) for each in (values, 1.0))
        scale = np.broadcast_to(1.0 if factors is None else factors[output], left.shape[-1])
        mean = _per_block((left**2).sum(-1), block) / np.maximum(_per_block(count.sum(-1), block), 1)
        beyond = _per_block((2 * loss.cost(left * scale) - count * scale**2).sum(-1), block)
        found += float(beyond[np.log1p(mean) > TELLING].sum())
    return max(found, 0.0)


def _per_block(values: NDArray[np.float64], block: Blocks) -> NDArray[Any]:
    return np.bincount(block.ravel(), values.ravel(), minlength=int(block.max()) + 1)


def gain(before: Losses, after: Losses) -> float:
    """Part of the excess loss that goes, over the blocks in which either model misses; 1 at most.

    Where fewer readings count than noise has freedom, less than noise can be left.
    """
    telling = _telling(before, after)
    excess = (before[telling] - NOISE).sum()
    return min(float((before - after)[telling].sum() / excess), 1.0) if excess > 0 else 0.0


def _telling(before: Losses, after: Losses) -> NDArray[np.bool_]:
    """Blocks in which either model misses."""
    return np.maximum(before, after) > TELLING


def typical_fall(before: Losses, after: Losses) -> float:
    """Mean fall of the loss over the blocks in which either model misses."""
    telling = _telling(before, after)
    return float((before - after)[telling].mean()) if telling.any() else 0.0


def compare(before: Losses, others: Sequence[Losses], stretch: int = 1) -> list[Evidence]:
    """Evidence for each of several models over one, tested together.

    Args:
        stretch: blocks in time over which the residuals are correlated: as many are flipped together.
    """
    scores = [signed_ranks(_by_stretch(before, after, stretch)) for after in others]
    p_values = sign_flip_test(np.array(scores))
    return [
        Evidence(
            gain(before, after),
            p_value,
            float(np.expm1(after.mean())),
            int(np.count_nonzero(score)),
            fall=typical_fall(before, after),
        )
        for after, p_value, score in zip(others, p_values, scores, strict=True)
    ]


def _by_stretch(before: Losses, after: Losses, stretch: int) -> Float[np.ndarray, " stretches"]:
    """Fall of the loss in each stretch, over the outputs and blocks in which either model misses."""
    telling = _telling(before, after)
    fall = np.where(telling, before - after, 0.0).sum(axis=0)
    starts = np.arange(0, len(fall), stretch)
    return np.add.reduceat(fall, starts)


EQUAL = 1e-9
"""Difference of two sums of scores that is rounding."""
ALIKE = 1e-3
"""Difference of two losses up to which a stretch does not tell two models apart: a thousandth of its mean
square."""


def signed_ranks(falls: Float[np.ndarray, " stretches"]) -> Float[np.ndarray, " stretches"]:
    """Ranks of the sizes with the signs of the falls, scaled to the unit sum of squares; 0 where none is.

    Wilcoxon's scores (Biometrics Bulletin 1, 1945): a stretch of a huge error decides no more than another.
    """
    there = np.abs(falls) > ALIKE
    ranks = np.zeros(len(falls))
    ranks[there] = np.sign(falls[there]) * rankdata(np.abs(falls[there]))
    return ranks / max(float(np.sqrt((ranks**2).sum())), 1e-300)


def sign_flip_bound(before: Losses, after: Losses, stretch: int = 1) -> float:
    r"""Largest p-value that the sign-flip test of one model can have, where too few flips are drawn to tell.

    :math:`P(\sum a_i ε_i ≥ s) ≤ e^{-s^2/2}` for random signs ε and :math:`\sum a_i^2 = 1` (Hoeffding,
    J. Amer. Statist. Assoc. 58, 1963, theorem 2).
    """
    total = float(signed_ranks(_by_stretch(before, after, stretch)).sum())
    return float(np.exp(-0.5 * max(total, 0.0) ** 2))


EXACT = 13
"""Stretches up to which all flips are counted; of more, :data:`FLIPS` are drawn (with a fixed seed)."""
FLIPS = 1 << EXACT


def sign_flip_test(scores: Float[np.ndarray, "models stretches"]) -> list[float]:
    """Chance that the largest of all sums is as large as each model's, if all signs were random.

    Flipping all models' scores of a stretch together keeps how they go together, and the largest sum allows
    for the number of models (maxT; Westfall and Young, Resampling-Based Multiple Testing, 1993, chapter 2).
    Exact where scores of different stretches are independent and as likely to be negative: a model
    that adds nothing is the likelier to be worse on data that it was not fitted to.
    """
    if not len(scores):
        return []
    largest = (_signs(scores.shape[1]) @ scores.T).max(axis=1)
    sums = scores.sum(axis=1)
    return [float(np.mean(largest >= value - EQUAL)) if value > 0 else 1.0 for value in sums]


@cache
def _signs(stretches: int) -> Float[np.ndarray, "flips stretches"]:
    """Signs of each flip; those of the first or the last row are all as they were."""
    if stretches <= EXACT:
        bits = np.arange(1 << stretches)[:, None] >> np.arange(stretches) & 1
    else:
        bits = np.random.default_rng(0).integers(0, 2, (FLIPS, stretches))
        bits[0] = 1  # a p-value is never zero
    return 2.0 * bits - 1


def block_means(
    residuals: Mapping[str, ArrayLike], weights: Mapping[str, ArrayLike], block: Blocks
) -> Float[np.ndarray, "columns blocks"]:
    """Mean weighted residual of every block and column, in the order of time; 0 where nothing counts."""
    means = []
    for output, values in residuals.items():
        shape = (*block.shape, -1)
        there = (np.asarray(weights[output]) > 0).reshape(shape)
        clipped = np.clip(np.asarray(values), -LARGEST, LARGEST).reshape(shape)
        for column in range(there.shape[-1]):
            rows = there[..., column]
            count = np.bincount(block[rows], minlength=int(block.max()) + 1)
            total = np.bincount(block[rows], clipped[..., column][rows], minlength=len(count))
            means.append(total / np.maximum(count, 1))
    return np.stack(means)


LARGEST = 10.0
"""Weighted residual beyond which more does not count where correlation is looked at."""
CHANCE = 2.0
"""Autocorrelation, in units of its standard deviation under independence, that is within chance."""


SAFE = 3
"""Correlation times that a stretch is long: sums over shorter ones still go together noticeably (with one of
two times and a first-order autoregression p < 0.05 came in 10 of 100 comparisons without a difference)."""


def correlated_blocks(means: Float[np.ndarray, "columns blocks"]) -> int:
    r"""Blocks in time that have to be flipped together; 1 where residuals are independent block by block.

    Otherwise three times the longest integrated autocorrelation time :math:`τ = 1 + 2 \sum_k ρ_k` of the
    mean residuals of the blocks, summed up to the first lag at which :math:`ρ_k` is within chance (Sokal,
    Monte Carlo Methods in Statistical Mechanics, 1997, section 3, with this window), and at most a quarter of
    the recording.
    """
    longest, n = 1.0, means.shape[1]
    for line in means:
        deviation = line - line.mean()
        power, time = max(float(deviation @ deviation), 1e-300), 1.0
        for lag in range(1, n // 4):
            rho = float(deviation[lag:] @ deviation[:-lag]) / power
            if rho < CHANCE / np.sqrt(n):
                break
            time += 2 * rho
        longest = max(longest, time)
    return 1 if round(longest) == 1 else max(min(round(SAFE * longest), n // 4), 1)
