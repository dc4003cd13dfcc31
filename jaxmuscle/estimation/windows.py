"""Windows of a recording: segments predicted in one go, with targets and weights."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.simulation import Track
from jaxmuscle.simulation.observed import Observed

LONGEST_BATCH = 64
"""Windows at most into which a machine whose inputs are all imposed is cut: no error, only faster."""

FACTOR = 1.25
"""Ratio of two sizes that follow each other: an eighth of a program's work is padding on average."""


def bucket(size: int) -> int:
    """The smallest size of the series 1, 2, 3, 4, 5, 7, 9, 12, 15, … that is not less than `size`."""
    found = 1
    while found < size:
        found = max(found + 1, math.ceil(FACTOR * found))
    return found


@dataclasses.dataclass(frozen=True)
class Windows:
    """Windows of equal length; the last one of a stretch may be cut short by its mask.

    Attributes:
        rows: first row of each window.
        samples: their length.
        mask: whether a sample of a window belongs to its stretch.
        held_out: whether a window lies in a stretch that no fit and no selection may see.
        fixed: whether recordings of other lengths are cut into windows as long.
    """

    rows: Int[np.ndarray, " windows"]
    samples: int
    mask: Bool[np.ndarray, "windows samples"]
    held_out: Bool[np.ndarray, " windows"]
    fixed: bool

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.rows)

    def sample_rows(self, total: int) -> Int[np.ndarray, "windows samples"]:
        """Row that each sample of each window is, of a recording of `total` rows."""
        return sample_rows(self.rows, self.samples, total)

    def only(self, chosen: Bool[np.ndarray, " windows"]) -> Windows:
        """Some of the windows."""
        parts = (self.rows[chosen], self.samples, self.mask[chosen], self.held_out[chosen])
        return Windows(*parts, self.fixed)


def sample_rows(
    first: Int[np.ndarray, " windows"], samples: int, total: int
) -> Int[np.ndarray, "windows samples"]:
    """Row of a recording of `total` rows that each sample of windows is; behind the end, the last row."""
    return np.minimum(first[:, None] + np.arange(samples), total - 1)


def stretches(mask: NDArray[np.bool_], breaks: tuple[int, ...]) -> list[tuple[int, int, bool]]:
    """Runs of equal values between breaks, as (first row, end, value)."""
    edges = sorted({0, *breaks, *(np.flatnonzero(np.diff(mask)) + 1).tolist(), len(mask)})
    return [(a, b, bool(mask[a])) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def cut(
    actuator: AbstractActuator, parts: Sequence[tuple[int, int, bool]], step: float, horizon: float | None
) -> Windows:
    """Cut stretches (first row, end, held out) into windows of `horizon` seconds.

    Without a horizon each stretch is one window, unless the bench imposes every state of the rig: then
    nothing is started anew at a window's edge and the length is free; it is then one of a series.
    """
    longest, fixed = max(stop - start for start, stop, _ in parts), False
    if set(actuator.imposed) >= {*actuator.measured, *actuator.derivatives}:
        total = sum(stop - start for start, stop, _ in parts)
        wanted = max(50, bucket(-(-total // LONGEST_BATCH)))
        samples, fixed = min(longest, wanted), wanted <= longest
    elif horizon is None:
        samples = longest
    else:
        wanted = max(2, round(horizon / step))
        samples, fixed = min(longest, wanted), wanted <= longest
    rows, masks, held = [], [], []
    for start, stop, out in parts:
        for row in range(start, stop, samples):
            rows.append(row)
            masks.append(np.arange(samples) < stop - row)
            held.append(out)
    return Windows(np.array(rows), samples, np.array(masks), np.array(held), fixed)


Residuals = dict[str, Float[Array, "windows samples *muscles"]]


class Problem(eqx.Module):
    """A recording cut into windows, with a weight for every predicted number.

    Attributes:
        targets: output → measured values, window by window.
        weights: output → one over the standard deviation to be expected of the residual, zero where masked.
        period: samples after which a link is started anew from what was measured; a window, or part of one.
        fixed: whether recordings of other lengths are cut into windows as long.
        share: part of the recording's rows that lies in its windows, in hundredths.
        begin: states at the first sample of the recording that are neither as measured nor at rest: name of
            a state, or of the effect whose state it is (an entry of an array by its index), → value.
    """

    track: Track
    rows: Int[Array, " windows"]
    targets: Residuals
    weights: Residuals
    period: Int[Array, ""]
    samples: int = eqx.field(static=True)
    total: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    fixed: bool = eqx.field(static=True)
    share: float = eqx.field(static=True)
    begin: dict[str, Array] = eqx.field(default_factory=dict)

    @property
    def sample_rows(self) -> Int[np.ndarray, "windows samples"]:
        """Row of the recording that each sample of each window is."""
        return sample_rows(np.asarray(self.rows), self.samples, self.track.command.shape[0])

    def with_weights(self, weights: Residuals) -> Problem:
        """A copy with other weights."""
        return eqx.tree_at(lambda p: p.weights, self, weights)

    def allowing(self, variance: Mapping[str, ArrayLike]) -> Problem:
        """A copy with weights that allow for a variance of each number beside the one that they stand for.

        Args:
            variance: output → variance, of the shape of its weights.
        """
        weights = {}
        for out, w in self.weights.items():
            own = np.asarray(w)
            counts = own > 0
            with np.errstate(divide="ignore", over="ignore"):
                known = 1 / np.where(counts, own, 1.0) ** 2 + np.asarray(variance[out])
                weights[out] = jnp.asarray(np.where(counts, 1 / np.sqrt(known), 0.0))
        return self.with_weights(weights)

    def reweighted(self, factors: Mapping[str, Float[np.ndarray, " columns"]]) -> Problem:
        """A copy with the weights of each output multiplied by a factor (one for each of its columns)."""
        return self.with_weights(
            {
                out: w * jnp.asarray(factors[out] if w.ndim > 2 else np.ravel(factors[out])[0])
                for out, w in self.weights.items()
            }
        )

    def in_parts(self, parts: int) -> Problem:
        """A copy in which every window is predicted in `parts`, each from the measured state.

        Errors have less time to grow, and the more so the nearer a motion is to sticking: the cost of a
        fit is a far smoother function of the parameters.
        """
        return eqx.tree_at(lambda p: p.period, self, jnp.asarray(-(-self.samples // parts)))

    def only(self, samples: np.ndarray) -> Problem:
        """A copy in which only the given samples count: boolean, one row a window."""
        return self.with_weights({o: w * _along(samples, w) for o, w in self.weights.items()})


def problem(
    observed: Observed,
    windows: Windows,
    substeps: int,
    ignored: Mapping[str, Bool[np.ndarray, "rows columns"]],
) -> Problem:
    """Cut `observed` into `windows`, weighted by the sensors' noise.

    Args:
        ignored: output → rows whose reading does not count, column by column.
    """
    index = windows.sample_rows(observed.samples)
    targets = {out: np.asarray(values)[index] for out, values in observed.outputs.items()}
    # By NumPy, here and wherever a recording is made ready: JAX would compile every operation by itself.
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = {
            out: (windows.mask[..., None] & ~ignored[out][index]).reshape(target.shape)
            / np.broadcast_to(np.asarray(observed.noise[out]), target.shape)
            for out, target in targets.items()
        }
    return Problem(
        observed.track,
        jnp.asarray(windows.rows),
        {out: jnp.asarray(values) for out, values in targets.items()},
        {out: jnp.asarray(values) for out, values in weights.items()},
        jnp.asarray(windows.samples),
        windows.samples,
        observed.samples,
        substeps,
        windows.fixed,
        share_of_rows(windows.mask, observed.samples),
    )


def share_of_rows(mask: Bool[np.ndarray, "windows samples"], rows: int) -> float:
    """Part of `rows` rows that lies in windows, in hundredths."""
    return round(float(mask.sum()) / rows, 2)


def _along(samples: np.ndarray, weights: Array) -> Array:
    return jnp.asarray(samples, dtype=float).reshape(samples.shape + (1,) * (weights.ndim - 2))
