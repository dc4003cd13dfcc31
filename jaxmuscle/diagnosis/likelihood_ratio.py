"""Likelihood ratio of two models: a test of a candidate, for recordings in which too little moves for a test
on unseen windows, and which of two candidates that such a test does not tell apart is the likelier.

Where a joint is moved twice and then rests, two stretches tell models apart. No test that flips signs can
then go below p = 1/4, however clearly one model is right: it does not use how large the errors are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.stats import chi2

from jaxmuscle.estimation.coloured_noise import memory

Residuals = Mapping[str, ArrayLike]
Line = Float[np.ndarray, " n"]
Counts = Bool[np.ndarray, " n"]

SMALLEST = 1e-12
"""p-value below which none is given: so far out the distribution is not that of any real noise."""


def likelihood_ratio_test(before: Residuals, after: Residuals, weights: Residuals, parameters: int) -> float:
    r"""Chance that `parameters` further ones lower the squares that much, if the truth has none of them.

    :math:`\sum_c (S_c - S'_c) / (σ_c^2 τ_c)` is about χ² with as many degrees of freedom, where S and S' are
    the sums of squared weighted residuals of a column without and with the parameters. σ² is the mean square
    that the larger model leaves, or 1 where that is less, and τ its autocorrelation time: noise that is
    larger than the sensor's, or correlated, counts as what it is (quasi-likelihood: McCullagh and Nelder,
    Generalized Linear Models, 1989, section 9.2.2, with the long-run variance in place of the variance).

    Both models are fitted to these residuals. It relies on models that are nearly linear over what they move
    by and on residuals that remember no longer than a small part of the recording.

    Args:
        before, after: weighted residuals of each output, (windows, samples) or with a muscle each.
        weights: positive where a reading counts.
        parameters: how many the larger model has more.
    """
    fall = 0.0
    for small, large, there in _columns(before, after, weights):
        fall += _fall(small, large, there) / (_mean_square(large, there) * _memory(large, there))
    return max(float(chi2.sf(fall, parameters)), SMALLEST) if fall > 0 else 1.0


def more_likely(one: Residuals, other: Residuals, weights: Residuals, parameters: int) -> float:
    r"""Twice the logarithm of the odds that the other model is the true one of two, about.

    :math:`\sum_c (S_c - S'_c) / (σ_c^2 τ_c) - k \ln n` (Schwarz, Ann. Stat. 6, 1978), as in
    :func:`likelihood_ratio_test` but of models that need not be nested: σ² and τ are those of the model that
    leaves more, so that neither is favoured; n: independent readings of the columns in which the models
    differ, as only these tell of their parameters; of all, where they predict the same: then the one with
    fewer parameters is the likelier.

    Args:
        one, other: weighted residuals of each output, (windows, samples) or with a muscle each.
        weights: positive where a reading counts.
        parameters: k, how many the other model has more.
    """
    fall, independent, of_all = 0.0, 0.0, 0.0
    for small, large, there in _columns(one, other, weights):
        time = max(_memory(each, there) for each in (small, large))
        size = max(_mean_square(each, there) for each in (small, large))
        fall += _fall(small, large, there) / (size * time)
        of_all += there.sum() / time
        if float(((small - large)[there] ** 2).sum()) > size:
            independent += there.sum() / time
    return fall - parameters * float(np.log(max(independent or of_all, 1.0)))


def _fall(small: Line, large: Line, there: Counts) -> float:
    """By how much the second sum of squares is less."""
    return float((small[there] ** 2 - large[there] ** 2).sum())


def _mean_square(line: Line, there: Counts) -> float:
    """1 where it is less: noise smaller than the sensor's is not believed."""
    return max(float((line[there] ** 2).mean()), 1.0)


def _memory(line: Line, there: Counts) -> float:
    """Autocorrelation time, in readings."""
    return memory(np.where(there, line, 0.0), there).time


def _columns(before: Residuals, after: Residuals, weights: Residuals) -> Iterator[tuple[Line, Line, Counts]]:
    """Residuals before and after and what counts, one column of one output after the other; of those with
    any that counts.
    """
    for output, weight in weights.items():
        there = np.asarray(weight) > 0
        shape = (there.shape[0] * there.shape[1], -1)
        lines = (np.asarray(each).reshape(shape).T for each in (before[output], after[output], there))
        yield from (each for each in zip(*lines, strict=True) if each[2].any())
