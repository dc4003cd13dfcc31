"""Matrices of a linear model outside JAX, for figures and texts: where to look, and the response there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

POINTS = 300
"""Frequencies of a curve."""
RESTING = 1e-9
"""Magnitude of a pole [rad/s] below which it is an integrator's."""


def frequencies(a: NDArray[np.float64]) -> NDArray[np.float64]:
    """From a tenth of the slowest pole of A that moves to ten times the fastest [rad/s]."""
    sizes = np.abs(np.linalg.eigvals(a))
    moving = sizes[sizes > RESTING]
    low, high = (moving.min(), moving.max()) if len(moving) else (1.0, 1.0)
    return np.geomspace(low / 10, high * 10, POINTS)


class StateSpace(NamedTuple):
    """A, B, C, D, and the names of the entries of x, u and y; of many models at once with axes before."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """G(jω) = C (jω - A)⁻¹ B + D: frequencies, outputs, inputs."""
        inner = 1j * omega[:, None, None] * np.eye(len(self.a)) - self.a
        inputs = np.broadcast_to(self.b.astype(complex), (len(omega), *self.b.shape))
        return self.c @ np.linalg.solve(inner, inputs) + self.d
