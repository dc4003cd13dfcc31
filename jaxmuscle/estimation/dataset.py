"""Datasets of a fit: recordings cut into windows, with weights, whitened where residuals share errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.missing_data import Mask
from jaxmuscle.estimation.padding import in_buckets, longer, padded, vector_without_padding
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.recordings.recording import Recording


@dataclasses.dataclass(frozen=True)
class Whitening:
    r"""The symmetric root :math:`C^{-1/2}` of the covariance :math:`C = I + S S^T`, window by window.

    .. math:: C^{-1/2} = I - S\,V \operatorname{diag}\frac{1}{r (1 + r)}\,V^T S^T,\quad
              S^T S = V \operatorname{diag}(λ)\,V^T,\quad r = \sqrt{1 + λ}

    Residuals with the covariance C become white by it (generalised least squares; Aitken 1936). As S has few
    columns, nothing as large as C is built.

    Attributes:
        shares: S, for each link its rows: by how much one standard deviation of each shared error changes
            the residuals, in units of their own noise.
        inner: what stands between S and its transpose.
    """

    shares: tuple[Float[np.ndarray, "windows n errors"], ...]
    inner: Float[np.ndarray, "windows errors errors"]

    @classmethod
    def of(cls, shares: Sequence[Float[np.ndarray, "windows n errors"]]) -> Whitening:
        """From S, link by link."""
        squares, axes = np.linalg.eigh(sum(np.swapaxes(s, 1, 2) @ s for s in shares))
        root = np.sqrt(1 + np.maximum(squares, 0.0))
        inner = (axes / (root * (1 + root))[:, None, :]) @ np.swapaxes(axes, 1, 2)
        return cls(tuple(shares), inner)

    def __call__(self, values: Float[np.ndarray, "... n"]) -> Float[np.ndarray, "... n"]:
        """Residuals of all links, or their slopes, one link after the other along the last axis."""
        ends = np.cumsum([s.shape[0] * s.shape[1] for s in self.shares])[:-1]
        parts = [
            part.reshape(*part.shape[:-1], *s.shape[:2])
            for part, s in zip(np.split(values, ends, axis=-1), self.shares, strict=True)
        ]
        pairs = list(zip(parts, self.shares, strict=True))
        common = sum(np.einsum("...wn,wnm->...wm", part, s) for part, s in pairs)
        common = np.einsum("...wm,wmk->...wk", common, self.inner)
        left = [part - np.einsum("...wk,wnk->...wn", common, s) for part, s in pairs]
        return np.concatenate([part.reshape(*values.shape[:-1], -1) for part in left], axis=-1)


@dataclasses.dataclass(frozen=True)
class Station:
    """One recording and its part of the fit.

    Attributes:
        actuator: the machine with what is known of this recording: its load, its supply.
        recording: as it was given; `filled` has its gaps bridged.
        problem: windows, targets and weights; zero weight where nothing is known, nothing is to count, or
            a window was padded.
        period: samples of a whole window.
        spread: standard deviation of each smoothed state, sample by sample.
        begins: for each state with which windows begin, output → change of its predictions (SI) by as much
            as the state may be off.
    """

    label: str
    actuator: AbstractActuator
    recording: Recording
    filled: Recording
    problem: Problem
    period: int
    spread: dict[str, Array]
    begins: tuple[dict[str, NDArray[np.float64]], ...] = ()

    @property
    def samples(self) -> int:
        """Readings that count."""
        return sum(int((np.asarray(w) > 0).sum()) for w in self.problem.weights.values())

    @cached_property
    def common(self) -> Problem:
        """The problem in sizes that recordings of similar lengths share, as compiled programs take it."""
        return in_buckets(self.problem)

    def own(self, values: ArrayLike) -> Float[np.ndarray, "... n"]:
        """Residuals or their slopes without what belongs to the padding of `common`."""
        outputs = [link.output for link in self.actuator.links]
        return vector_without_padding(np.asarray(values), outputs, self.problem, self.common)

    @cached_property
    def layout(self) -> ResidualLayout:
        """The order of its residuals."""
        return ResidualLayout.of(self.actuator, self.problem)

    @cached_property
    def _whitening(self) -> Whitening | None:
        if not self.begins:
            return None
        shares = []
        for link in self.actuator.links:
            weights = np.asarray(self.problem.weights[link.output])
            each = [(change[link.output] * weights).reshape(len(weights), -1) for change in self.begins]
            shares.append(np.stack(each, axis=-1))
        return Whitening.of(shares)

    def whitened(self, values: Float[np.ndarray, "... n"]) -> Float[np.ndarray, "... n"]:
        """Weighted residuals, or their slopes, without what the states share with which windows begin.

        What is not a number stays none, and counts as zero for the others.
        """
        if self._whitening is None:
            return values
        wrong = ~np.isfinite(values)
        return np.where(wrong, values, self._whitening(np.where(wrong, 0.0, values)))

    def reweighted(self, factors: Mapping[str, NDArray[np.float64]]) -> Station:
        """With the weights of each output multiplied by a factor (one for each of its columns)."""
        return dataclasses.replace(self, problem=self.problem.reweighted(factors))


def station(
    actuator: AbstractActuator,
    recording: Recording,
    label: str,
    mask: Mask | None,
    noise: Mapping[str, float],
) -> Station:
    """Prepare one recording.

    Args:
        noise: column → standard deviation of its sensor (SI), in place of the card's.

    Raises:
        InputError: too little of the recording can be used.
    """
    card = dataclasses.replace(recording.card, noise={**recording.card.noise, **noise})
    prepared = case(dataclasses.replace(recording, card=card), 0.0, mask, actuator, twice=True)
    problem = prepared.training
    # A sensor without any noise would leave everything to its rounding.
    weights = {out: jnp.asarray(np.where(np.isfinite(w), w, 0.0)) for out, w in problem.weights.items()}
    return Station(
        label,
        actuator,
        recording,
        prepared.filled,
        problem.with_weights(weights),
        problem.samples,
        prepared.observed.spread,
    )


def in_parts(stations: Sequence[Station], parts: int) -> list[Station]:
    """Each window predicted in `parts`, each from the measured state: a smoother cost."""
    return [
        dataclasses.replace(
            s, problem=eqx.tree_at(lambda p: p.period, s.problem, jnp.asarray(-(-s.period // parts)))
        )
        for s in stations
    ]


def widened(stations: Sequence[Station], factor: float) -> list[Station]:
    """With dry friction smoothed over motions `factor` times as large."""
    where = lambda problem: problem.track.widening  # noqa: E731
    none = lambda leaf: leaf is None  # noqa: E731
    return [
        dataclasses.replace(s, problem=eqx.tree_at(where, s.problem, jnp.asarray(factor), is_leaf=none))
        for s in stations
    ]


MOST_PADDING = 1.5
"""Work with all recordings padded to one shape, relative to the work without, up to which they share it."""


def aligned(stations: Sequence[Station]) -> list[Station]:
    """The same recordings padded to one shape, so that they share one compilation; as they are if too unlike.

    Padding repeats the last sample, and its readings have no weight.
    """
    problems = [s.problem for s in stations]
    windows = max(len(p.rows) for p in problems)
    samples = max(p.samples for p in problems)
    rows = max(p.track.command.shape[0] for p in problems)
    total = max(p.total for p in problems)
    own = sum(len(p.rows) * p.samples + p.total for p in problems)
    work = len(problems) * (windows * samples + total)
    if work > MOST_PADDING * own or len({p.substeps for p in problems}) > 1:
        return list(stations)
    breaks = any(p.track.begins is not None for p in problems)

    def alike(own: Problem) -> Problem:
        common = padded(own, windows=windows, samples=samples, rows=rows, total=total, breaks=breaks)
        return jax.tree.map(jnp.asarray, common)

    return [
        dataclasses.replace(
            s,
            problem=alike(s.problem),
            spread={name: jnp.asarray(longer(values, rows)) for name, values in s.spread.items()},
        )
        for s in stations
    ]
