"""Free parameters: the vector that a fit moves, the transform, bounds and prior of each entry, and the
actuator that a point stands for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.parameter_names import of_machine
from jaxmuscle.parameters import Parameter, replace


@dataclasses.dataclass(frozen=True)
class Prior:
    """A normal distribution, of a positive parameter on its logarithm: mean and standard deviation, SI."""

    mean: float
    std: float


Vector = NDArray[np.float64]


HALF = 0.5
"""Relative scale of a parameter of which nothing is known beforehand."""


@dataclasses.dataclass(frozen=True)
class Unknown:
    """One entry of the vector.

    Attributes:
        name: the place's name; ``mass[lift-2]`` for one of a single recording.
        recordings: numbers of the recordings on which it acts.
        start, lower, upper: where a fit begins and what it must stay within (SI).
        scale: how far a fit may well move it (SI); the prior's standard deviation if there is one.
    """

    name: str
    place: Parameter
    recordings: tuple[int, ...]
    start: float
    lower: float
    upper: float
    scale: float
    prior: Prior | None = None


class Unknowns:
    r"""All entries and their coordinates u.

    A parameter that is positive has u = ln θ, any other u = θ / scale. Bounds are kept by the descent, not
    by a transform: at a bound the slope is what it is, and a value may end exactly there. The prior counts
    as one more residual, (θ - mean)/std, of a positive one mean·ln(θ/mean)/std.
    """

    def __init__(self, entries: Sequence[Unknown]) -> None:
        """Lay out `entries` in the given order."""
        self.entries = tuple(entries)
        of = lambda values: np.array(values, dtype=float)  # noqa: E731
        self.logarithmic = np.array([e.place.positive for e in entries], dtype=bool)
        self.scale = of([e.scale for e in entries])
        # A scale that is a narrow prior's must not make the steps short where a start is far off.
        wide = [HALF * abs(e.start) / e.scale for e in entries]
        self.reach = np.where(self.logarithmic, 1.0, np.maximum(of(wide), 1.0))
        self.start = of([e.start for e in entries])
        self.lower = self.coordinates(of([e.lower for e in entries]))
        self.upper = self.coordinates(of([e.upper for e in entries]))
        self._mean = of([e.start if e.prior is None else e.prior.mean for e in entries])
        self._std = of([np.inf if e.prior is None else e.prior.std for e in entries])

    def __len__(self) -> int:
        """Number of entries."""
        return len(self.entries)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(entry.name for entry in self.entries)

    def values(self, u: Vector) -> Vector:
        """Values θ (SI) at coordinates u; leading axes are kept."""
        safe = np.where(self.logarithmic, u, 0.0)
        return np.where(self.logarithmic, np.exp(np.clip(safe, -700.0, 700.0)), u * self.scale)

    def coordinates(self, values: Vector) -> Vector:
        """The inverse of :meth:`values`; zero of a positive parameter is at minus infinity."""
        with np.errstate(divide="ignore"):
            safe = np.where(self.logarithmic, np.maximum(values, 0.0), 1.0)
            return np.where(self.logarithmic, np.log(safe), values / self.scale)

    def slopes(self, u: Vector) -> Vector:
        """dθ/du."""
        return np.where(self.logarithmic, self.values(u), self.scale)

    def prior_residuals(self, u: Vector) -> Vector:
        """Distances from the priors in standard deviations; zero without one."""
        mean = np.where(self.logarithmic, self._mean, 1.0)
        shifted = np.where(self.logarithmic, mean * (u - np.log(mean)), u * self.scale - self._mean)
        return shifted / self._std

    @property
    def prior_slopes(self) -> Vector:
        """Derivatives of :meth:`prior_residuals`, each by its own coordinate: constants."""
        return np.where(self.logarithmic, self._mean, self.scale) / self._std

    def acting_on(self, recording: int) -> NDArray[np.int64]:
        """Positions of the entries that act on a recording, in their order."""
        return np.array([i for i, e in enumerate(self.entries) if recording in e.recordings], dtype=np.int64)


AT_BOUND = 1e-9
"""Distance from a bound, relative to 1 and to the bound, up to which a value is at it."""


def moved_machine(
    actuator: AbstractActuator, unknowns: Unknowns, u: NDArray[np.float64], number: int
) -> AbstractActuator:
    """The machine in a recording with the values at coordinates u; neither offsets nor initial states are
    part of it.
    """
    values = settled(unknowns, u)
    entries = [(unknowns.entries[i].place.path, float(values[i])) for i in unknowns.acting_on(number)]
    return replace(actuator, {path: value for path, value in entries if of_machine(path)})


def at_bound(unknowns: Unknowns, u: NDArray[np.float64]) -> NDArray[np.int64]:
    """-1 for coordinates at their lower bound, 1 at their upper one, 0 for the others."""

    def near(bound: NDArray[np.float64]) -> Bool[np.ndarray, " k"]:
        finite = np.isfinite(bound)
        safe = np.where(finite, bound, 0.0)
        return finite & (np.abs(u - safe) <= AT_BOUND * (1 + np.abs(safe)))

    return np.where(near(unknowns.lower), -1, np.where(near(unknowns.upper), 1, 0))


def settled(unknowns: Unknowns, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (SI) at coordinates u; those at a bound are the bound, to the last bit."""
    ends = at_bound(unknowns, u)
    lower = np.array([entry.lower for entry in unknowns.entries])
    upper = np.array([entry.upper for entry in unknowns.entries])
    return np.where(ends < 0, lower, np.where(ends > 0, upper, unknowns.values(u)))
