"""From the best point to the result: how sure, what is not determined, how it predicts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.covariance import covariance
from jaxmuscle.estimation.entries import correlations, fitted, outcomes
from jaxmuscle.estimation.identifiability import Undetermined, undetermined, without_influence
from jaxmuscle.estimation.predictions import noise_table, predictions
from jaxmuscle.estimation.profile import profiles
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.estimation.rough import without_rough
from jaxmuscle.estimation.search import Found
from jaxmuscle.estimation.series import Series, series
from jaxmuscle.estimation.settled import at_bound, moved_machine
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.estimation.whiteness import residual_tests


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
    return FitResult(
        actuator=machines[0],
        actuators=machines,
        parameters=fitted(unknowns, u, sure, ends, to_values, labels),
        correlations=correlations(sure, unknowns, ends),
        cost=found.best.cost,
        samples=objective.samples,
        code=found.best.code,
        starts=outcomes(found),
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
