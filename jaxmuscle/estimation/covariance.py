"""Covariance of fitted parameters by four estimators (cluster-robust among them), and the largest of their
standard deviations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray

from jaxmuscle.estimation.coloured_noise import coloured_meat, memory
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.residual_analysis import Series

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


Matrix = Float[np.ndarray, "k k"]

SINGULAR = 1e-11
"""Eigenvalue of the scaled information matrix, relative to the largest, below which nothing is known."""
OUTSIDE = 1e-6
"""Share of a parameter in what is not known, squared, from which it has no standard deviation."""


@dataclasses.dataclass(frozen=True)
class Covariance:
    """Standard deviations of the coordinates u by four rules, and the correlation between them.

    Attributes:
        independent: as if the residuals were white, of the size that they have.
        coloured: allowing for their autocorrelation too.
        windows: allowing for any correlation within a window of prediction, or a twentieth of the only one.
        states: allowing for the states with which windows begin, as uncertain as they are.
        std: the largest of the four; infinite where the data and the priors leave a parameter open.
        assumed: (JᵀJ)⁻¹ as if the noise were white and what it was said to be: how the cost curves.
        correlations: those of `coloured`.
        times: recording, column → autocorrelation time of the residuals [samples].
    """

    independent: Float[np.ndarray, " k"]
    coloured: Float[np.ndarray, " k"]
    windows: Float[np.ndarray, " k"]
    states: Float[np.ndarray, " k"]
    std: Float[np.ndarray, " k"]
    assumed: Float[np.ndarray, " k"]
    correlations: Matrix
    times: dict[tuple[int, str], float]


def covariance(
    lines: Sequence[Series],
    unknowns: Unknowns,
    loss: Loss,
    fixed: Bool[np.ndarray, " k"],
    scores: Float[np.ndarray, "sources k"] | None = None,
) -> Covariance:
    r"""Covariance of the coordinates at the minimum, :math:`A^{-1} B A^{-1}` (Huber 1967).

    A is the Gauss-Newton matrix Σ E[ψ'] J Jᵀ with the priors' 1/std²; B is the covariance of the score
    Σ J ψ by the rule at hand, to which a prior adds its own 1/std², being a measurement like any other.

    Args:
        fixed: coordinates at a bound; they count as known there and get no standard deviation.
        scores: changes of the score by uncertain states (`begun.state_scores`); `None` for none.
    """
    size = len(unknowns)
    prior = np.diag(unknowns.prior_slopes**2)
    bread, white, meat = prior.copy(), prior.copy(), prior.copy()
    errors = [loss.weight(line.residual) * line.residual for line in lines]
    for line, psi in zip(lines, errors, strict=True):
        curving = float(loss.slope(line.residual)[line.counts].mean()) if line.counts.any() else 1.0
        products = line.slopes @ line.slopes.T
        bread += max(curving, 0.05) * products
        white += float((psi**2).sum()) / max(int(line.counts.sum()), 1) * products
    space, times = _Space(bread, fixed), {}
    for line, psi in zip(lines, errors, strict=True):
        # What is fitted to all lines together takes little from each.
        meat += coloured_meat(line.slopes, psi, line.counts, space.inverse)
        remembered = memory(psi, line.counts, line.slopes, space.inverse)
        times[line.recording, line.column] = remembered.time
    grouped = window_scores(lines, errors)
    groups = len(grouped)
    independent, coloured = space.sandwich(white), space.sandwich(meat)
    windows = np.zeros((size, size))
    if groups > 1:
        # Few windows seem to agree better than they do, as all parameters were fitted to them.
        few = groups / max(groups - int((~fixed).sum()), 1)
        windows = space.sandwich(prior + few * grouped.T @ grouped)
    begun = np.zeros((0, size)) if scores is None else scores
    states = space.sandwich(white + begun.T @ begun)
    stds = [_roots(matrix) for matrix in (independent, coloured, windows, states)]
    found = [np.where(space.open, np.inf, std) for std in stds]
    safe = np.where(stds[1] > 0, stds[1], 1.0)
    correlations = coloured / np.outer(safe, safe)
    # Where the data leave a direction open, what lies in it goes together, and with nothing else.
    loose = space.open[:, None] | space.open[None, :]
    correlations = np.where(loose, space.null_correlations(), correlations)
    return Covariance(
        independent=found[0],
        coloured=found[1],
        windows=found[2],
        states=found[3],
        std=np.maximum.reduce(found),
        assumed=_roots(space.inverse),
        correlations=correlations,
        times=times,
    )


class _Space:
    """What the information matrix determines: its inverse there, and which parameters lie outside."""

    def __init__(self, matrix: Matrix, fixed: Bool[np.ndarray, " k"]) -> None:
        """Split the space of the rows that are not fixed."""
        free = np.flatnonzero(~fixed)
        size = len(matrix)
        self.inverse, self.null = np.zeros((size, size)), np.zeros((size, size))
        if len(free):
            inner = matrix[free[:, None], free]
            scale = np.where(np.diag(inner) > 0, np.sqrt(np.diag(inner)), 1.0)
            values, vectors = np.linalg.eigh(inner / np.outer(scale, scale))
            known = values > SINGULAR * max(float(values.max()), 1e-300)
            kept, lost = vectors[:, known], vectors[:, ~known] / scale[:, None]
            self.inverse[free[:, None], free] = (kept / values[known]) @ kept.T / np.outer(scale, scale)
            lost = np.linalg.qr(lost)[0]
            self.null[free[:, None], free] = lost @ lost.T
        self.open: NDArray[np.bool_] = np.diag(self.null) > OUTSIDE

    def sandwich(self, meat: Matrix) -> Matrix:
        """A⁺ B A⁺."""
        return self.inverse @ meat @ self.inverse

    def null_correlations(self) -> Matrix:
        """Correlations of an infinite variance along the open directions."""
        size = np.sqrt(np.where(self.open, np.diag(self.null), 1.0))
        both = self.open[:, None] & self.open[None, :]
        return np.where(both, self.null / np.outer(size, size), 0.0)


def _roots(matrix: Matrix) -> Float[np.ndarray, " k"]:
    return np.sqrt(np.maximum(np.diag(matrix), 0.0))


@dataclasses.dataclass(frozen=True)
class Minimum:
    """A point, the residuals there and their derivatives.

    Attributes:
        u: coordinates of the unknowns.
        ends: -1 for those at a lower bound, 1 at an upper one, else 0.
        scores: changes of the score by uncertain states (`begun.state_scores`); `None` for none.
    """

    u: Float[np.ndarray, " k"]
    lines: Sequence[Series]
    unknowns: Unknowns
    loss: Loss
    ends: Int[np.ndarray, " k"]
    scores: Float[np.ndarray, "sources k"] | None = None

    @property
    def held(self) -> Bool[np.ndarray, " k"]:
        """Coordinates at a bound."""
        return self.ends != 0

    def covariance(self, held: Bool[np.ndarray, " k"] | None = None) -> Covariance:
        """How sure the coordinates are, with those known that are `held`: at a bound when `None`."""
        fixed = self.held if held is None else held
        return covariance(self.lines, self.unknowns, self.loss, fixed, self.scores)
