"""A recording cut into windows, ready to be compared with what a machine predicts."""

from __future__ import annotations

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from jaxmuscle.fitting.windows import Windows, sample_rows
from jaxmuscle.recordings.track import Observed
from jaxmuscle.simulation import Track

Residuals = dict[str, Float[Array, "windows samples *muscles"]]


class Problem(eqx.Module):
    """A recording cut into windows, with a weight for every predicted number.

    Attributes:
        targets: output → measured values, window by window.
        weights: output → one over the standard deviation to be expected of the residual, zero where masked.
        period: samples after which a link is started anew from what was measured; a window, or part of one.
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

    def in_parts(self, parts: int) -> Problem:
        """A copy in which every window is predicted in `parts`, each from the measured state.

        Errors have less time to grow, and the more so the nearer a motion is to sticking: the cost of a
        fit is a far smoother function of the parameters.
        """
        return eqx.tree_at(lambda p: p.period, self, jnp.asarray(-(-self.samples // parts)))

    def only(self, samples: np.ndarray) -> Problem:
        """A copy in which only the given samples count: boolean, one row a window."""
        return self.with_weights({o: w * _along(samples, w) for o, w in self.weights.items()})


def problem(observed: Observed, windows: Windows, substeps: int) -> Problem:
    """Cut `observed` into `windows`, weighted by the sensors' noise."""
    index = windows.sample_rows(observed.samples)
    targets = {out: np.asarray(values)[index] for out, values in observed.outputs.items()}
    # By NumPy, here and wherever a recording is made ready: JAX would compile every operation by itself.
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = {
            out: windows.mask.reshape(windows.mask.shape + (1,) * (target.ndim - 2))
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
    )


def _along(samples: np.ndarray, weights: Array) -> Array:
    return jnp.asarray(samples, dtype=float).reshape(samples.shape + (1,) * (weights.ndim - 2))
