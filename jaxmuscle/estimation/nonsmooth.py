"""Windows with non-differentiable predictions, whose linearisation says nothing about a parameter's
variance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.residual_analysis import Series

Vector = NDArray[np.float64]

SHARE = 0.99
"""Share of one window in what all of them say of a parameter from which the window is looked at."""
UNKNOWN = 1.0
"""Standard deviation of a coordinate by the other windows from which nothing can be compared with them."""
HELD = 0.1
"""Change of a window's residuals relative to what its derivatives promise, below which they do not hold."""
DISTANCES = 4
"""Distances at which a derivative is tested, from where it promises a change of 1 to a standard deviation."""

Key = tuple[int, int, int]
"""Recording, window and coordinate."""


@dataclasses.dataclass(frozen=True)
class RoughWindow:
    """A window that is left out of what is known of a parameter.

    Attributes:
        begin, end: on the recording's clock [s].
        parameter: the one whose derivative does not hold.
        promised, found: change of the window's residuals, root of the sum of squares in units of the noise,
            as that parameter moves by one standard deviation of what the other windows know of it.
    """

    recording: str
    begin: float
    end: float
    parameter: str
    promised: float
    found: float


def without_rough(
    objective: Objective, u: Vector, lines: Sequence[Series]
) -> tuple[list[Series], tuple[RoughWindow, ...]]:
    """`lines` with no derivatives where they do not hold, and the windows and parameters where that is so.

    Near a fold of the motion (dry friction that just sticks, a contact that is just missed) derivatives grow
    without bound within a window, while the prediction hardly changes: the linear theory of standard
    deviations is void there, and one such window would make every parameter look as known as it makes one
    direction, or drown all others in rounding. Looked at are windows that outweigh all others together in a
    parameter, ten to one in standard deviations, and every parameter of a window that has failed in one. The
    window is simulated with the parameter moved to either side: by as little as should change its residuals
    by 1, by one standard deviation as the other windows know it, and by steps between. Where they change by
    less than a tenth of what the derivatives promise, at every distance, the derivatives by that parameter
    are set to zero in that window; those by other parameters stay. Residuals that saturate hold at the
    shortest distance. A parameter that the others do not know, to a factor e or to its scale, stays too,
    unless its window has failed in another: then the shortest distance alone decides.
    """
    lines, found, judged, failed = list(lines), [], set(), set()
    while waiting := {k: v for k, v in _suspects(objective, lines, failed).items() if k not in judged}:
        key, distances = next(iter(waiting.items()))
        judged.add(key)
        told = _tested(objective, u, lines, key, distances)
        if told is not None:
            failed.add(key[:2])
            lines = [_silenced(line, key) for line in lines]
            found.append(told)
    return lines, tuple(found)


def _information(lines: Sequence[Series], count: int) -> dict[tuple[int, int], Vector]:
    """(recording, window) → sum of squared derivatives of all its residuals, one a coordinate."""
    totals: dict[tuple[int, int], Vector] = {}
    for line in lines:
        inside = line.window >= 0
        sums = np.zeros((int(line.window.max(initial=-1)) + 1, count))
        np.add.at(sums, line.window[inside], line.slopes[:, inside].T ** 2)
        for window in np.unique(line.window[inside]):
            key = (line.recording, int(window))
            totals[key] = totals.get(key, np.zeros(count)) + sums[window]
    return totals


def _suspects(
    objective: Objective, lines: Sequence[Series], failed: set[tuple[int, int]]
) -> dict[Key, Vector]:
    """What is to be tested → at which distances: windows that outweigh all others, or failed already."""
    totals = _information(lines, len(objective.unknowns))
    together = sum(totals.values(), start=np.zeros(len(objective.unknowns)))
    found = {}
    for (number, window), own in totals.items():
        others = np.maximum(together - own, 0.0)
        known = others > 1 / UNKNOWN**2
        told = (own > SHARE * together) & known
        if (number, window) in failed:
            told = (own > 0) & (known | (own > 1 / UNKNOWN**2))
        for i in map(int, np.flatnonzero(told)):
            farthest = (others[i] if known[i] else own[i]) ** -0.5
            found[number, window, i] = np.geomspace(min(own[i] ** -0.5, farthest), farthest, DISTANCES)
    return found


def _tested(
    objective: Objective, u: Vector, lines: Sequence[Series], key: Key, distances: Vector
) -> RoughWindow | None:
    """What is to be told of the window if its derivatives by one coordinate do not hold."""
    number, window, i = key
    unknowns, own = objective.unknowns, [line for line in lines if line.recording == number]
    points = np.tile(u, (2 * len(distances) + 1, 1))
    points[1:, i] += np.concatenate([distances, -distances])
    points = np.where(np.arange(len(u)) == i, np.clip(points, unknowns.lower, unknowns.upper), points)
    values = _window_residuals(objective, number, points, window)
    away = np.where(np.isfinite(values[1:]), values[1:] - values[0], 0.0)
    slope = np.sqrt(sum(float((line.slopes[i, line.window == window] ** 2).sum()) for line in own))
    # The farther of the two sides at each distance: a bound may be in the way of one.
    changes = np.linalg.norm(away, axis=1).reshape(2, -1).max(axis=0)
    promised = (slope * np.abs(points[1:, i] - u[i])).reshape(2, -1).max(axis=0)
    if (changes >= HELD * promised).any():
        return None
    station = objective.stations[number]
    first = int(np.asarray(station.problem.rows)[window])
    last = min(first + station.period, len(station.recording)) - 1
    time = station.recording.time
    span = float(time[first]), float(time[last])
    return RoughWindow(station.label, *span, unknowns.names[i], float(promised[-1]), float(changes[-1]))


def _window_residuals(
    objective: Objective, number: int, points: Float[np.ndarray, "points k"], window: int
) -> Float[np.ndarray, "points n"]:
    """Residuals of all columns in one window at each point."""
    by_output = objective.stations[number].layout.split(objective.residuals(number, points)[0])
    own = [values[:, window].reshape(len(points), -1) for values in by_output.values()]
    return np.concatenate(own, axis=1)


def _silenced(line: Series, key: Key) -> Series:
    """Without derivatives by one coordinate in a window."""
    number, window, i = key
    if line.recording != number:
        return line
    here = (line.window == window) & (np.arange(len(line.slopes)) == i)[:, None]
    return dataclasses.replace(line, slopes=np.where(here, 0.0, line.slopes))
