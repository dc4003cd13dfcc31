"""The entries of a result: parameters with their uncertainty, their correlations, how the starts ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.estimation.covariance import Covariance
from jaxmuscle.estimation.fitted import Fitted, StartOutcome
from jaxmuscle.estimation.lane import FAILED, Lane
from jaxmuscle.estimation.search import Found
from jaxmuscle.estimation.settled import settled
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.parameters import Declaration

ALIKE = 0.5
"""Distance of two costs per mean square residual up to which two starts reached one minimum: of points that
far apart in cost the data cannot tell which is nearer to the truth."""
BESIDE, RUGGED = 1.0, 0.01
"""Standard deviations between two ends in every parameter, and part of their cost, up to which both are
in one minimum too: where dry friction sticks and slips, the cost is rugged by as much."""

DECLARED = tuple(field.name for field in dataclasses.fields(Declaration))


def fitted(
    unknowns: Unknowns,
    u: NDArray[np.float64],
    sure: Covariance,
    ends: NDArray[np.int64],
    to_values: NDArray[np.float64],
    labels: Sequence[str],
) -> dict[str, Fitted]:
    """Each parameter by name.

    Args:
        to_values: slopes of the values by the coordinates.
        labels: of the recordings.
    """
    values = settled(unknowns, u)
    found = {}
    for i, entry in enumerate(unknowns.entries):
        size = abs(float(to_values[i]))
        found[entry.name] = Fitted(
            value=float(values[i]),
            std=size * float(sure.std[i]),
            path=entry.place.path,
            **{name: getattr(entry.place, name) for name in DECLARED},
            start=entry.start,
            lower=entry.lower,
            upper=entry.upper,
            independent=size * float(sure.independent[i]),
            coloured=size * float(sure.coloured[i]),
            windows=size * float(sure.windows[i]),
            states=size * float(sure.states[i]),
            prior=None if entry.prior is None else (entry.prior.mean, entry.prior.std),
            at_bound={-1: "lower", 1: "upper"}.get(int(ends[i])),
            recording=labels[entry.recordings[0]] if entry.name != entry.place.name else None,
        )
    return found


def correlations(sure: Covariance, unknowns: Unknowns, ends: NDArray[np.int64]) -> pd.DataFrame:
    """Correlations of the parameters that are not at a bound."""
    table = pd.DataFrame(sure.correlations, index=unknowns.names, columns=unknowns.names)
    inner = [name for name, end in zip(unknowns.names, ends, strict=True) if not end]
    return table.loc[inner, inner]


def outcomes(found: Found, sure: Covariance) -> tuple[StartOutcome, ...]:
    """Where each start ended, and whether the data can tell that from the best."""
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
            lane.code != FAILED and _alike(lane, found.best, scale, sure.std),
        )
        for point, lane in zip(found.points, found.lanes, strict=True)
    )


def _alike(lane: Lane, best: Lane, scale: float, std: NDArray[np.float64]) -> bool:
    beside = bool((np.abs(lane.u - best.u) <= BESIDE * std).all()) and lane.cost <= (1 + RUGGED) * best.cost
    return beside or lane.cost - best.cost <= ALIKE * scale
