"""Objective function: the loss of all recordings' residuals and the distances from the priors, with gradient
and Gauss-Newton matrix, for several points at once on all cores.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property, partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.checkpoint import NOTHING_KEPT, Checkpoint
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.fingerprint import digest
from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.residuals import (
    evaluate,
    moved,
    moved_as_measured,
    values_and_chosen_slopes,
    values_and_slopes,
)
from jaxmuscle.estimation.serialization import arrays, plain, restored
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN, Local
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameters import get

Arrays = tuple[NDArray[np.float64], ...]


def divided(
    evaluate: Callable[[Float[np.ndarray, "width k"]], Arrays],
    points: Float[np.ndarray, "lanes k"],
    width: int,
) -> Arrays:
    """`evaluate` on so many points at a time, on all cores, joined.

    The last part is filled with its last point: all are of one shape, for which a function is compiled once
    however many points there are. XLA runs one program on one core; other threads keep the next ones busy.
    """
    parts = -(-len(points) // width)
    filled = np.concatenate([points, np.repeat(points[-1:], parts * width - len(points), axis=0)])
    pieces = np.split(filled, parts)
    found = on_all_cores(evaluate, pieces)
    return tuple(np.concatenate(each)[: len(points)] for each in zip(*found, strict=True))


Vector = NDArray[np.float64]
WRITTEN_EVERY = 1.0
"""Seconds between two writings of a checkpoint of evaluations, which may take only milliseconds each."""


@dataclasses.dataclass(frozen=True)
class SharedProgram:
    """Derivatives by any of many parameters, compiled once for every fit that moves some of them.

    Attributes:
        movable: paths of the parameters.
        tangents: derivatives that are taken at a time, at least one; what is not used of them are zeros.
    """

    movable: tuple[str, ...]
    tangents: int


@dataclasses.dataclass(frozen=True)
class Objective:
    """The cost of the unknowns' coordinates u on several recordings.

    Attributes:
        width: points that are evaluated in one program; any number of them is, in parts.
        program: what evaluates it; a program of these unknowns alone when `None`.
        checkpoint: keeps what :meth:`at` gives for a fit that goes on after an interruption.
    """

    stations: Sequence[Station]
    unknowns: Unknowns
    loss: Loss
    width: int = 1
    program: SharedProgram | None = None
    checkpoint: Checkpoint = NOTHING_KEPT

    @cached_property
    def samples(self) -> int:
        """Readings that count."""
        return sum(station.samples for station in self.stations)

    def paths(self, number: int) -> tuple[str, ...]:
        """Where in the machine and its sensors the values act on one recording."""
        return tuple(self.unknowns.entries[i].place.path for i in self.unknowns.acting_on(number))

    def moved(
        self, number: int, u: Vector, problem: Problem | None = None
    ) -> tuple[AbstractActuator, Problem]:
        """Machine and problem of one recording at the coordinates u; `problem`: another form of its own."""
        station = self.stations[number]
        whole = station.problem if problem is None else problem
        return moved(station.actuator, whole, self.paths(number), self._values(number, u))

    def _values(self, number: int, u: Vector) -> list[Array]:
        """Values (SI) that act on one recording."""
        return [jnp.asarray(x) for x in self.unknowns.values(u)[self.unknowns.acting_on(number)]]

    def at(self, points: Float[np.ndarray, "lanes k"]) -> list[Local]:
        """Cost and derivatives at several points."""
        if not self.checkpoint.keeps:
            return self._evaluated(points)
        return self.checkpoint.recall(
            "evaluation",
            [(self._fingerprint, point) for point in points],
            lambda new: self._evaluated(points[new]),
            plain,
            lambda record: Local(**arrays(restored(record), "gradient", "matrix")),
            WRITTEN_EVERY,
        )

    @cached_property
    def _fingerprint(self) -> str:
        """A hash of all but the point that an evaluation depends on."""
        stations = [(s.actuator, s.problem, s.begins) for s in self.stations]
        loss = type(self.loss).__qualname__, vars(self.loss)
        return digest(stations, self.unknowns.entries, loss, self.width, self.program)

    def _evaluated(self, points: Float[np.ndarray, "lanes k"]) -> list[Local]:
        size = len(self.unknowns)
        cost, bad = np.zeros(len(points)), np.zeros(len(points), dtype=int)
        gradient, matrix = np.zeros((len(points), size)), np.zeros((len(points), size, size))
        for number in range(len(self.stations)):
            index = self.unknowns.acting_on(number)
            parts = divided(partial(self._assembled, number), points, self.width)
            cost, bad = cost + parts[0], bad + parts[1].astype(int)
            gradient[:, index] += parts[2]
            matrix[:, index[:, None], index] += parts[3]
        prior, slope = self.unknowns.prior_residuals(points), self.unknowns.prior_slopes
        cost += 0.5 * (prior**2).sum(axis=-1)
        gradient += prior * slope
        matrix += np.diag(slope**2)
        whole = zip(cost.tolist(), gradient, matrix, bad.tolist(), strict=True)
        return [Local(*each) for each in whole]

    def _assembled(self, number: int, points: Float[np.ndarray, "some k"]) -> Arrays:
        """Of one recording: cost, predictions that are not numbers, gradient and Gauss-Newton matrix."""
        values, slopes = (self.stations[number].whitened(x) for x in self._by_values(number, points))
        inner = self.unknowns.slopes(points)[:, self.unknowns.acting_on(number)]
        wrong = ~np.isfinite(values)
        values = np.where(wrong, 0.0, values)
        # Far from anything sensible a square may be infinite: that start is then given up.
        with np.errstate(over="ignore", invalid="ignore"):
            rows = self.loss.weighted(slopes, values)
            # A prediction that is not a number costs the same under every loss.
            cost = self.loss.cost(values).sum(axis=1) + 0.5 * BROKEN**2 * wrong.sum(axis=1)
            gradient = inner * (rows @ values[..., None])[..., 0]
            matrix = inner[:, :, None] * inner[:, None, :] * (rows @ slopes.transpose(0, 2, 1))
        return cost, wrong.sum(axis=1), gradient, matrix

    def with_priors(self, u: Vector) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "k n"]]:
        """Residuals of all recordings by the loss (:meth:`Loss.rooted`) and distances from the priors, and
        their derivatives.
        """
        size, parts = len(self.unknowns), []
        for number in range(len(self.stations)):
            r, slopes = (each[0] for each in self.residuals(number, u[None]))
            whole = np.zeros((size, len(r)))
            whole[self.unknowns.acting_on(number)] = self.loss.rooted_slopes(slopes, r)
            parts.append((self.loss.rooted(r), whole))
        parts.append((self.unknowns.prior_residuals(u), np.diag(self.unknowns.prior_slopes)))
        values, slopes = zip(*parts, strict=True)
        return np.concatenate(values), np.concatenate(slopes, axis=1)

    def values_with_priors(self, u: Vector) -> Float[np.ndarray, " n"]:
        """What :meth:`with_priors` gives, without derivatives."""
        parts = []
        for number, station in enumerate(self.stations):
            values, paths = self._values(number, u), self.paths(number)
            found = evaluate(*moved_as_measured(station.actuator, station.problem, paths, values))
            r = np.concatenate([found[link.output].ravel() for link in station.actuator.links])
            parts.append(self.loss.rooted(station.whitened(np.where(np.abs(r) < BROKEN, r, np.nan))))
        return np.concatenate([*parts, self.unknowns.prior_residuals(u)])

    def residuals(
        self, number: int, points: Float[np.ndarray, "lanes k"]
    ) -> tuple[Float[np.ndarray, "lanes n"], Float[np.ndarray, "lanes m n"]]:
        """Residuals of one recording, as they are squared, and their derivatives by what acts on it.

        A prediction that is not a number has a residual that is not, and no slope.
        """
        r, slopes = self.deviations(number, points)
        station = self.stations[number]
        return station.whitened(r), station.whitened(slopes)

    def deviations(
        self, number: int, points: Float[np.ndarray, "lanes k"]
    ) -> tuple[Float[np.ndarray, "lanes n"], Float[np.ndarray, "lanes m n"]]:
        """Predicted minus measured, weighted, and its derivatives by the coordinates that act on it."""
        r, slopes = divided(partial(self._by_values, number), points, self.width)
        inner = self.unknowns.slopes(points)[:, self.unknowns.acting_on(number), None]
        with np.errstate(over="ignore"):
            return r, slopes * inner

    def _by_values(
        self, number: int, points: Float[np.ndarray, "lanes k"]
    ) -> tuple[Float[np.ndarray, "lanes n"], Float[np.ndarray, "lanes m n"]]:
        """Residuals of one recording and their derivatives by the values (SI) that act on it."""
        station, index = self.stations[number], self.unknowns.acting_on(number)
        values, paths = self.unknowns.values(points)[:, index], self.paths(number)
        if self.program is None:
            found = values_and_slopes(jnp.asarray(values), station.actuator, station.common, paths)  # pyright: ignore
            r, slopes = (station.own(each) for each in found)
        else:
            each = [_by_chosen(self.program, station, paths, point) for point in values]
            r, slopes = (np.stack(parts) for parts in zip(*each, strict=True))
        with np.errstate(over="ignore", invalid="ignore"):
            sound = np.isfinite(slopes.sum())
        return r, slopes if sound else np.where(np.isfinite(slopes), slopes, 0.0)


def _by_chosen(
    program: SharedProgram, station: Station, paths: Sequence[str], values: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "m n"]]:
    """Residuals and derivatives at one point by the program of all movable paths."""
    movable, tangents = program.movable, program.tangents
    theta = np.array([float(get(station.actuator, path)) for path in movable])
    places = np.array([movable.index(path) for path in paths], dtype=np.int64)
    theta[places] = values
    parts = max(1, -(-len(places) // tangents))
    chosen = np.full((parts, tangents), len(movable))
    chosen.flat[: len(places)] = places
    found = [
        values_and_chosen_slopes(
            jnp.asarray(theta), jnp.asarray(part), station.actuator, station.common, movable
        )  # pyright: ignore[reportGeneralTypeIssues]
        for part in chosen
    ]
    slopes = np.concatenate([np.asarray(part) for _, part in found])
    return station.own(found[0][0]), station.own(slopes[: len(places)])
