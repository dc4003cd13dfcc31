"""From the best point to the result: how sure, what is not determined, how it predicts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.begun import state_scores
from jaxmuscle.estimation.bounded import with_inner_ends
from jaxmuscle.estimation.conflict import with_conflicts
from jaxmuscle.estimation.entries import correlations, fitted, outcomes
from jaxmuscle.estimation.identifiability import Undetermined, undetermined, without_influence
from jaxmuscle.estimation.minimum import Minimum
from jaxmuscle.estimation.predictions import noise_table, predictions
from jaxmuscle.estimation.profile import profiles
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.estimation.rough import without_rough
from jaxmuscle.estimation.search import Found
from jaxmuscle.estimation.series import Series, series
from jaxmuscle.estimation.settled import at_bound, moved_machine
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.estimation.whiteness import residual_tests
from jaxmuscle.parameter_names import of_machine


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
    lines, rough = without_rough(objective, u, series(objective, u))
    ends = at_bound(unknowns, u)
    minimum = Minimum(u, lines, unknowns, objective.loss, ends, state_scores(objective, u, lines))
    sure = minimum.covariance()
    idle, combinations = _identifiability(lines, unknowns, u, ends)
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
    parameters = fitted(unknowns, u, sure, ends, unknowns.slopes(u), labels)
    parameters = with_conflicts(with_inner_ends(parameters, minimum), minimum)
    return FitResult(
        actuator=machines[0],
        actuators=machines,
        parameters=parameters,
        correlations=correlations(sure, unknowns, ends),
        cost=found.best.cost,
        samples=objective.samples,
        code=found.best.code,
        starts=outcomes(found, sure),
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
    lines: Sequence[Series], unknowns: Unknowns, u: NDArray[np.float64], ends: NDArray[np.int64]
) -> tuple[tuple[str, ...], tuple[Undetermined, ...]]:
    slopes = np.concatenate([line.slopes for line in lines], axis=1)
    idle = without_influence(slopes, unknowns.names)
    kept = [i for i, name in enumerate(unknowns.names) if name not in idle and not ends[i]]
    relative, logarithmic = _relative(unknowns, u)
    inner = slopes[kept] * relative[kept, None]
    prior = (unknowns.prior_slopes * relative)[kept] ** 2
    names = [unknowns.names[i] for i in kept]
    return idle, undetermined(inner @ inner.T, prior, names, logarithmic[kept])


def _relative(unknowns: Unknowns, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Slopes of the coordinates by the logarithm of the values, and where they are these.

    What may be zero, but is not near it, such as the force of a friction, is told apart from others by its
    ratio to them as well as what is always positive. An offset or an initial state adds to something.
    """
    values = unknowns.values(u)
    machines = np.array([of_machine(entry.place.path) for entry in unknowns.entries])
    away = machines & ~unknowns.logarithmic & (np.abs(values) >= unknowns.scale)
    return np.where(away, values / unknowns.scale, 1.0), unknowns.logarithmic | away


def _inputs(
    actuator: AbstractActuator, columns: dict[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """What drives the machine: its commands, or the columns that a bench imposes."""
    imposed = [c for state in actuator.imposed for c in actuator.measured.get(state, ())]
    return {name: columns[name] for name in (*actuator.commands, *imposed)}
