"""A quadratic model of a cost: how far it may fall, and the best step within a radius."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

Vector = NDArray[np.float64]

ROUNDING = 1e-13
"""Curvature along a combination of coordinates, relative to the largest, below which it is rounding."""
NEWTON, NEAR = 30, 0.05
"""Iterations at most, and how far beyond its radius a step still counts as long as it."""


class Quadratic:
    r"""The model :math:`g^T p + \frac12 p^T H p` with each coordinate in units of 1/`unit`."""

    def __init__(self, matrix: Float[np.ndarray, "k k"], gradient: Vector, unit: Vector) -> None:
        """H, positive semidefinite; g; and what coordinates are multiplied by."""
        curvatures, self._axes = np.linalg.eigh(matrix / (unit[:, None] * unit))
        self._curvatures = np.maximum(curvatures, ROUNDING * curvatures[-1])
        self._along = self._axes.T @ (gradient / unit)
        self._unit = unit

    @property
    def fall(self) -> float:
        """By how much the model falls to its minimum: gᵀH⁻¹g/2."""
        return 0.5 * float(self._along @ (self._along / self._curvatures))

    def damped(self, damping: float) -> Vector:
        """The step with (H + λ unit²) p = -g (Marquardt 1963)."""
        return -self._axes @ (self._along / (self._curvatures + damping)) / self._unit

    def within(self, radius: float) -> Vector:
        """The step of at most this length, in units, that lowers the model most.

        Newton's method for the damping at which the step is as long as the radius (Hebden 1973; Moré 1978,
        "The Levenberg-Marquardt algorithm", equation 5.5).
        """
        damping, step, size = 0.0, self._along, np.inf
        for _ in range(NEWTON):
            step = self._along / (self._curvatures + damping)
            size = float(np.sqrt(step @ step))
            if size <= radius * (1 + NEAR):
                break
            slope = float(step @ (step / (self._curvatures + damping)))
            damping += (size / radius - 1) * size**2 / slope
        return -self._axes @ (step * min(1.0, radius / size if size > 0 else 1.0)) / self._unit
