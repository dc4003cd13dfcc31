"""Windows whose derivatives say nothing about how far the parameters can move."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.series import Series

Vector = NDArray[np.float64]

SHARE = 0.99
"""Share of one window in what all of them say of a parameter from which the window is looked at."""
UNKNOWN = 1.0
"""Standard deviation of a coordinate by the other windows from which nothing can be compared with them."""
HELD = 0.1
"""Change of a window's residuals relative to what its derivatives promise, below which they do not hold."""


@dataclasses.dataclass(frozen=True)
class RoughWindow:
    """A window that is left out of the standard deviations.

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
    objective: Objective, u: Vector, lines: Sequence[Series], lanes: int
) -> tuple[list[Series], tuple[RoughWindow, ...]]:
    """`lines` with no derivatives in windows whose derivatives do not hold, and these windows.

    Near a fold of the motion (dry friction that just sticks, a contact that is just missed) derivatives grow
    without bound within a window, while the prediction hardly changes: the linear theory of standard
    deviations is void there, and one such window would make every parameter look as known as it makes one
    direction, or drown all others in rounding. Looked at are windows that outweigh all others together in a
    parameter, ten to one in standard deviations; each is simulated with that parameter moved by one standard
    deviation, as the other windows know it, to either side. Left out is a window whose residuals then change
    by less than a tenth of what its derivatives promise. A parameter that the others do not know, to a factor
    e or to its scale, cannot be tested so: its windows stay.
    """
    lines, found, sound = list(lines), [], set()
    while waiting := [each for each in _suspects(objective, lines) if each[:2] not in sound]:
        number, window, *_ = waiting[0]
        told = _tested(objective, u, lines, waiting[0], lanes)
        if told is None:
            sound.add((number, window))
            continue
        lines = [_silenced(line, window) if line.recording == number else line for line in lines]
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


def _suspects(objective: Objective, lines: Sequence[Series]) -> list[tuple[int, int, int, float]]:
    """(recording, window, coordinate, one standard deviation of it) of windows that outweigh all others."""
    unknowns = objective.unknowns
    totals = _information(lines, len(unknowns))
    together = sum(totals.values(), start=np.zeros(len(unknowns)))
    found = []
    for (number, window), own in totals.items():
        others = np.maximum(together - own, 0.0)
        told = (own > SHARE * together) & (others > 1 / UNKNOWN**2)
        if told.any():
            i = int(np.argmax(np.where(told, own / np.where(told, others, 1.0), 0.0)))
            found.append((number, window, i, float(others[i] ** -0.5)))
    return found


def _tested(
    objective: Objective, u: Vector, lines: Sequence[Series], suspect: tuple[int, int, int, float], lanes: int
) -> RoughWindow | None:
    """What is to be told of the window if its derivatives do not hold."""
    number, window, i, std = suspect
    unknowns, own = objective.unknowns, [line for line in lines if line.recording == number]
    changes, promised = [], 0.0
    here = _window_residuals(objective, number, u, window, lanes)
    for side in (1.0, -1.0):
        moved = np.clip(u[i] + side * std, unknowns.lower[i], unknowns.upper[i])
        there = _window_residuals(
            objective, number, np.where(np.arange(len(u)) == i, moved, u), window, lanes
        )
        changes.append(float(np.linalg.norm(np.where(np.isfinite(there), there - here, 0.0))))
        slope = np.sqrt(sum(float((line.slopes[i, line.window == window] ** 2).sum()) for line in own))
        promised = max(promised, slope * abs(moved - u[i]))
    if max(changes) >= HELD * promised:
        return None
    station = objective.stations[number]
    first = int(np.asarray(station.problem.rows)[window])
    last = min(first + station.period, len(station.recording)) - 1
    time = station.recording.time
    span = float(time[first]), float(time[last])
    return RoughWindow(station.label, *span, unknowns.names[i], promised, max(changes))


def _window_residuals(
    objective: Objective, number: int, u: Vector, window: int, lanes: int
) -> Float[NDArray, " n"]:
    """Residuals of all columns in one window."""
    values, begin, parts = objective.residuals(number, np.stack([u] * lanes))[0][0], 0, []
    for link in objective.stations[number].actuator.links:
        weights = objective.stations[number].problem.weights[link.output]
        table = values[begin : begin + weights.size].reshape(weights.shape)
        begin += weights.size
        parts.append(table[window].ravel())
    return np.concatenate(parts)


def _silenced(line: Series, window: int) -> Series:
    """Without derivatives in a window."""
    return dataclasses.replace(line, slopes=np.where(line.window == window, 0.0, line.slopes))
