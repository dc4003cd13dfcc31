"""Weights of residuals: noise of the sensors, and variance from uncertain measured states."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.coloured_noise import memory
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.losses import SQUARES, Loss
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.residual_analysis import series
from jaxmuscle.estimation.residuals import evaluate
from jaxmuscle.estimation.windows import Problem, Residuals

Line = NDArray[np.float64]


def expected_spread(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that the uncertainty of the smoothed states puts on the predictions of the links.

    Each rate of a measured state, the least certain of what is smoothed, is shifted by ± its standard
    deviation and, because channels are read one after the other and the instant at which a motion turns is
    not known better, by ± one sample: both where it starts a window and where it is imposed. Half the
    difference of the predictions, squared, is summed. Zero where nothing counts. Where windows begin with
    what the past tells, these beginnings are shifted, too: readings by ± their noise, rates, which lag, by
    ± `SPREAD` of their standard deviations.
    """
    pairs: dict[str, tuple[tuple[Line, Line], ...]] = {}
    for name in actuator.derivatives:
        values, size = np.asarray(problem.track.measured[name]), np.asarray(spread[name])
        pairs[name] = ((values + size, values - size), _neighbours(values, problem))
    rows = _starting_rows(problem)
    for name, error in problem.track.start_errors.items():
        values = np.asarray(problem.track.measured[name])
        begin = np.zeros_like(values)
        begin[rows] = (SPREAD if name in actuator.derivatives else 1.0) * np.asarray(error.spread)[rows]
        pairs[name] = (*pairs.get(name, ()), (values + begin, values - begin))
    return spread_between(actuator, problem, pairs)


def _starting_rows(problem: Problem) -> NDArray[np.int64]:
    """Rows at which windows, or their parts, begin with what was measured."""
    within = np.arange(0, problem.samples, int(problem.period))
    rows = (np.asarray(problem.rows)[:, None] + within).ravel()
    return np.unique(np.minimum(rows, problem.track.command.shape[0] - 1))


def spread_between(
    actuator: AbstractActuator, problem: Problem, pairs: Mapping[str, Iterable[tuple[Line, Line]]]
) -> Residuals:
    """Half the difference of the predictions under two values of a measured state, squared and summed.

    Zero where nothing counts.

    Args:
        pairs: name of a measured state → pairs of values along the recording, of which each adds a term.
    """

    def predicted(name: str, values: Line) -> dict[str, Line]:
        measured = {**problem.track.measured, name: jnp.asarray(values)}
        found = evaluate(actuator, eqx.tree_at(lambda p: p.track.measured, problem, measured))
        return {out: np.asarray(each) for out, each in found.items()}

    total = {out: np.zeros(target.shape) for out, target in problem.targets.items()}
    for name, both in pairs.items():
        for one, other in both:
            up, down = predicted(name, one), predicted(name, other)
            total = {out: total[out] + (0.5 * (up[out] - down[out])) ** 2 for out in total}
    found = {}
    for out, weights in problem.weights.items():
        w = np.asarray(weights)
        with np.errstate(over="ignore"):
            found[out] = jnp.asarray(np.where(w > 0, total[out] / np.where(w > 0, w, 1.0) ** 2, 0.0))
    return found


def _neighbours(values: Line, problem: Problem) -> tuple[Line, Line]:
    """The value a sample before and a sample later; its own where that sample is none that counts.

    A held-out sample next to the windows must not reach even their weights.
    """
    rows = problem.sample_rows
    counts = np.zeros(len(values), dtype=bool)
    for weights in problem.weights.values():
        counts[rows[(np.asarray(weights) > 0).reshape(*rows.shape, -1).any(-1)]] = True
    along = (-1, *[1] * (values.ndim - 1))
    before, after = np.roll(counts, 1), np.roll(counts, -1)
    before[0] = after[-1] = False
    late = np.where(before.reshape(along), np.roll(values, 1, axis=0), values)
    return late, np.where(after.reshape(along), np.roll(values, -1, axis=0), values)


SPREAD = 2.0
"""Standard deviations by which rates are shifted where windows begin with them."""


def weighted(objective: Objective, u: NDArray[np.float64]) -> Objective:
    """`objective` with weights that allow for uncertain states at the coordinates u."""
    numbers = range(len(objective.stations))
    return dataclasses.replace(objective, stations=[_weighted(objective, i, u) for i in numbers])


def variance(actuator: AbstractActuator, problem: Problem, spread: dict[str, Array]) -> Residuals:
    """Variance that uncertain rates of the measured states put on the predictions of the links.

    Where a window begins with them, as in a diagnosis (`estimation.weights.expected_spread`): each rate
    shifted by ± two standard deviations and by ± one sample. Where a bench imposes them, that would hide what
    the data say of fast motion: a rate is shifted by ± its standard deviation, and by a sample only where the
    motion turns, since dry friction turns there with it. Half the difference of the predictions, squared.
    """
    if not set(actuator.derivatives) <= set(actuator.imposed):
        return expected_spread(actuator, problem, {n: SPREAD * values for n, values in spread.items()})

    pairs = {}
    for name in actuator.derivatives:
        values, size = np.asarray(problem.track.measured[name]), np.asarray(spread[name])
        late, early = np.concatenate([values[:1], values[:-1]]), np.concatenate([values[1:], values[-1:]])
        turning = late * early <= 0
        late, early = np.where(turning, late, values), np.where(turning, early, values)
        pairs[name] = ((values + size, values - size), (late, early))
    return spread_between(actuator, problem, pairs)


def _weighted(objective: Objective, number: int, u: NDArray[np.float64]) -> Station:
    station = objective.stations[number]
    machine, problem = objective.moved(number, u)
    # An offset moves targets, not weights.
    return dataclasses.replace(
        station, problem=station.problem.allowing(variance(machine, problem, station.spread))
    )


def with_estimated_noise(objective: Objective, u: NDArray[np.float64]) -> Objective:
    """With the noise of each column of each recording as the size of its residuals at u.

    The size by the loss (`Loss.size`), which for squares is the maximum-likelihood estimate, and under a
    robust loss is right for normal noise. Each recording has its own: benches, ranges of a sensor and what
    the model lacks differ.
    """
    stations = []
    for number, station in enumerate(objective.stations):
        layout, factors = station.layout, {}
        for output, part in layout.split(objective.residuals(number, u[None])[0][0]).items():
            counted = np.where(layout.table(output, station.problem.weights[output]) > 0, part, np.nan)
            # A column of which nothing counts keeps what it has.
            size = np.nan_to_num(objective.loss.size(counted, (0, 1)), nan=1.0)
            factors[output] = 1 / np.maximum(size, 1e-6)
        stations.append(station.reweighted(factors))
    return dataclasses.replace(objective, stations=stations)


@dataclasses.dataclass(frozen=True)
class Discrepancy:
    r"""What a model leaves of one output beyond the noise of its sensor.

    Attributes:
        readings: N, how many count.
        square: r², the mean square of the weighted residuals.
        time: τ, their integrated autocorrelation time in samples, at least 1.
    """

    readings: int
    square: float
    time: float

    @classmethod
    def of(cls, residual: Line, counts: NDArray[np.bool_], loss: Loss = SQUARES) -> Discrepancy:
        """From the weighted residuals in time, and which of them count; their size is that by a loss."""
        readings = int(counts.sum())
        size = float(loss.size(residual[counts])) if readings else 0.0
        if size <= 1:
            return cls(readings, size**2, 1.0)
        # At least one of them is independent of the others.
        time = min(memory(np.where(counts, residual, 0.0), counts).time, readings)
        return cls(readings, size**2, time)

    @property
    def excess(self) -> float:
        r""":math:`(r^2 - 1)_+`."""
        return max(self.square - 1, 0.0)

    @property
    def factor(self) -> float:
        r"""What weights are multiplied by: :math:`1/\sqrt{1 + (r^2 - 1)_+ τ}`."""
        return float(1 / np.sqrt(1 + self.excess * self.time))

    @property
    def cost(self) -> float:
        r"""Cost of what is left: :math:`\frac N2 \min(r^2, 1) + \frac{N}{2τ} \ln(1 + (r^2 - 1)_+ τ)`.

        Its derivative by r² is that of half the sum of squares with weights by `factor`: a fit whose weights
        are those of its own residuals is at a minimum of it, priors added.
        """
        beyond = float(np.log1p(self.excess * self.time)) / self.time
        return 0.5 * self.readings * (min(self.square, 1.0) + beyond)


def with_discrepancy(objective: Objective, u: NDArray[np.float64]) -> Objective:
    r"""With what the model leaves at u counted as uncertainty beside the noise of the sensors.

    .. math:: σ^2 → σ^2 \left(1 + \max(r^2 - 1, 0)\, τ\right)

    r: size of a column's residuals in units of σ; τ: their integrated autocorrelation time in samples, as a
    discrepancy lasts and its readings are no independent ones. The sum of all squares is then worth as many
    readings as there are independent ones (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001, on why a
    model's discrepancy has to be part of its calibration). Priors keep their meaning: held against the noise
    of the sensors alone, thousands of rows of a misfit outweigh any of them.

    Args:
        objective: weighted by the noise of the sensors.
    """
    factors: dict[int, dict[str, list[float]]] = {}
    for line in series(objective, u):
        own = factors.setdefault(line.recording, {}).setdefault(line.output, [])
        own.append(Discrepancy.of(line.residual, line.counts, objective.loss).factor)
    stations = [
        station.reweighted({output: np.array(each) for output, each in factors.get(number, {}).items()})
        for number, station in enumerate(objective.stations)
    ]
    return dataclasses.replace(objective, stations=stations)
