"""From the best point to the result: how sure, what is not determined, how it predicts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.covariance import Covariance, covariance
from jaxmuscle.estimation.fitted import Fitted, StartOutcome
from jaxmuscle.estimation.identifiability import Undetermined, undetermined, without_influence
from jaxmuscle.estimation.lane import FAILED
from jaxmuscle.estimation.names import of_machine
from jaxmuscle.estimation.predictions import noise_table, predictions
from jaxmuscle.estimation.profile import profiles
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.estimation.rough import without_rough
from jaxmuscle.estimation.search import Found
from jaxmuscle.estimation.series import Series, series
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.estimation.whiteness import residual_tests
from jaxmuscle.parameters import replace

AT_BOUND = 1e-9
"""Distance from a bound, relative to 1 and to the bound, up to which a value is at it."""
ALIKE = 0.5
"""Distance of two costs per mean square residual up to which two starts reached one minimum: of points that
far apart in cost the data cannot tell which is nearer to the truth."""


def conclude(
    found: Found,
    actuator: AbstractActuator,
    wanted: Sequence[str],
    settings: dict[str, Any],
    progress: Callable[[str], None],
    begin: float,
) -> FitResult:
    """Judge the best point of a search; `wanted`: places whose profiles are to be computed."""
    objective, unknowns, u = found.objective, found.objective.unknowns, found.best.u
    progress("judging the fit")
    lines, rough = without_rough(objective, u, series(objective, u, found.limits.lanes), found.limits.lanes)
    ends = at_bound(unknowns, u)
    sure = covariance(lines, unknowns, objective.loss, ends != 0)
    idle, combinations = _identifiability(lines, unknowns, ends)
    chosen = [i for i, e in enumerate(unknowns.entries) if e.place.name in wanted and not ends[i]]
    if chosen:
        progress("computing profile likelihoods")
    curves = profiles(objective.at, unknowns, (u, found.best.cost), sure, chosen, found.limits)
    machines = tuple(
        moved_machine(station.actuator, unknowns, u, number)
        for number, station in enumerate(objective.stations)
    )
    inputs = [_inputs(station.actuator, station.filled.columns) for station in objective.stations]
    labels = [station.label for station in objective.stations]
    # Standard deviations of the values, from those of the coordinates.
    to_values = unknowns.slopes(u)
    correlations = _correlations(sure, unknowns, ends)
    return FitResult(
        actuator=machines[0],
        actuators=machines,
        parameters=_fitted(unknowns, u, sure, ends, to_values, labels),
        correlations=correlations,
        cost=found.best.cost,
        samples=objective.samples,
        code=found.best.code,
        starts=_outcomes(found),
        profiles=tuple(curves),
        undetermined=combinations,
        idle=idle,
        tests=residual_tests(lines, labels, inputs),
        noise=noise_table(objective, lines, sure),
        predictions=predictions(objective, u, machines, lines, sure),
        cards={station.label: station.recording.card for station in objective.stations},
        settings=settings,
        iterations=found.iterations,
        seconds=time.monotonic() - begin,
        rough=rough,
    )


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

    def near(bound: NDArray[np.float64]) -> Bool[NDArray[np.bool_], " k"]:
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


def _identifiability(
    lines: Sequence[Series], unknowns: Unknowns, ends: NDArray[np.int64]
) -> tuple[tuple[str, ...], tuple[Undetermined, ...]]:
    slopes = np.concatenate([line.slopes for line in lines], axis=1)
    idle = without_influence(slopes, unknowns.names)
    kept = [i for i, name in enumerate(unknowns.names) if name not in idle and not ends[i]]
    inner = slopes[kept]
    prior = unknowns.prior_slopes[kept] ** 2
    names = [unknowns.names[i] for i in kept]
    return idle, undetermined(inner @ inner.T, prior, names, unknowns.logarithmic[kept])


def _inputs(
    actuator: AbstractActuator, columns: dict[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """What drives the machine: its commands, or the columns that a bench imposes."""
    imposed = [c for state in actuator.imposed for c in actuator.measured.get(state, ())]
    return {name: columns[name] for name in (*actuator.commands, *imposed)}


def _correlations(sure: Covariance, unknowns: Unknowns, ends: NDArray[np.int64]) -> pd.DataFrame:
    table = pd.DataFrame(sure.correlations, index=unknowns.names, columns=unknowns.names)
    inner = [name for name, end in zip(unknowns.names, ends, strict=True) if not end]
    return table.loc[inner, inner]


def _fitted(
    unknowns: Unknowns,
    u: NDArray[np.float64],
    sure: Covariance,
    ends: NDArray[np.int64],
    to_values: NDArray[np.float64],
    labels: Sequence[str],
) -> dict[str, Fitted]:
    values = settled(unknowns, u)
    found = {}
    for i, entry in enumerate(unknowns.entries):
        size = abs(float(to_values[i]))
        found[entry.name] = Fitted(
            value=float(values[i]),
            std=size * float(sure.std[i]),
            unit=entry.place.unit,
            meaning=entry.place.meaning,
            path=entry.place.path,
            positive=entry.place.positive,
            start=entry.start,
            lower=entry.lower,
            upper=entry.upper,
            independent=size * float(sure.independent[i]),
            coloured=size * float(sure.coloured[i]),
            windows=size * float(sure.windows[i]),
            prior=None if entry.prior is None else (entry.prior.mean, entry.prior.std),
            at_bound={-1: "lower", 1: "upper"}.get(int(ends[i])),
            recording=labels[entry.recordings[0]] if entry.name != entry.place.name else None,
        )
    return found


def _outcomes(found: Found) -> tuple[StartOutcome, ...]:
    unknowns = found.objective.unknowns
    scale = max(2 * found.best.cost / max(found.limits.samples, 1), 1e-6)
    named = lambda u: dict(zip(unknowns.names, unknowns.values(u).tolist(), strict=True))  # noqa: E731
    return tuple(
        StartOutcome(
            named(point),
            named(lane.u),
            lane.cost,
            lane.code,
            lane.reason,
            lane.steps,
            lane.code != FAILED and lane.cost - found.best.cost <= ALIKE * scale,
        )
        for point, lane in zip(found.points, found.lanes, strict=True)
    )
