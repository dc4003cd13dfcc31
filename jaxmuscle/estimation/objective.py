"""What a fit minimises: the loss of all recordings' residuals and the distances from the priors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.slopes import values_and_slopes
from jaxmuscle.estimation.stations import Station
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.fitting.residuals import BROKEN

Vector = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Local:
    """Cost, gradient and Gauss-Newton matrix at one point; how many predictions are not numbers there."""

    cost: float
    gradient: Float[NDArray, " k"]
    matrix: Float[NDArray, "k k"]
    broken: int


@dataclasses.dataclass(frozen=True)
class Objective:
    """The cost of the unknowns' coordinates u on several recordings."""

    stations: Sequence[Station]
    unknowns: Unknowns
    loss: Loss

    @cached_property
    def samples(self) -> int:
        """Readings that count."""
        return sum(station.samples for station in self.stations)

    def at(self, points: Float[NDArray, "lanes k"]) -> list[Local]:
        """Cost and derivatives at several points."""
        size = len(self.unknowns)
        cost, bad = np.zeros(len(points)), np.zeros(len(points), dtype=int)
        gradient, matrix = np.zeros((len(points), size)), np.zeros((len(points), size, size))
        for number in range(len(self.stations)):
            r, slopes = self.residuals(number, points)
            index = self.unknowns.acting_on(number)
            for lane, (values, rows) in enumerate(zip(r, slopes, strict=True)):
                wrong = ~np.isfinite(values)
                values = np.where(wrong, 0.0, values)
                w = self.loss.weight(values)
                # A prediction that is not a number costs the same under every loss.
                cost[lane] += self.loss.cost(values).sum() + 0.5 * BROKEN**2 * wrong.sum()
                bad[lane] += int(wrong.sum())
                gradient[lane, index] += rows @ (w * values)
                matrix[lane][np.ix_(index, index)] += (rows * w) @ rows.T
        prior, slope = self.unknowns.prior_residuals(points), self.unknowns.prior_slopes
        cost += 0.5 * (prior**2).sum(axis=-1)
        gradient += prior * slope
        matrix += np.diag(slope**2)
        whole = zip(cost.tolist(), gradient, matrix, bad.tolist(), strict=True)
        return [Local(*each) for each in whole]

    def residuals(
        self, number: int, points: Float[NDArray, "lanes k"]
    ) -> tuple[Float[NDArray, "lanes n"], Float[NDArray, "lanes m n"]]:
        """Residuals of one recording and their derivatives by the coordinates that act on it.

        A prediction that is not a number has a residual that is not, and no slope.
        """
        station, index = self.stations[number], self.unknowns.acting_on(number)
        paths = tuple(self.unknowns.entries[i].place.path for i in index)
        thetas = jnp.asarray(self.unknowns.values(points)[:, index])
        r, slopes = values_and_slopes(thetas, station.actuator, station.problem, paths)  # pyright: ignore
        inner = self.unknowns.slopes(points)[:, index, None]
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = np.asarray(slopes) * inner
        return np.asarray(r), np.where(np.isfinite(scaled), scaled, 0.0)
