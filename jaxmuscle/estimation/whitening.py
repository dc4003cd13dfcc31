"""Residuals that share errors, made independent of each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


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
