"""Pattern of what a model leaves: a tone, a jump or a drift in time, a ripple over a measured variable.

A frame that shakes, a weight that was put on, a cable that was pulled, the teeth of a gear leave something
that no smooth function of the measured variables follows. How fast it swings, when it began, after which way
it repeats is what leads to it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize_scalar

from jaxmuscle.diagnosis.diagnosis_data import DRIFT, JUMP, RIPPLE, TONE, Pattern
from jaxmuscle.diagnosis.discrepancy import MissingRate
from jaxmuscle.estimation.case import Case

BLOCKS = 20
"""Stretches of the recording, by turns fitted and judged."""
PERIODS = 3.0
"""Periods of a tone or a ripple that there are at least: fewer are a drift, or a smooth dependence."""
CELLS = 2048
"""Cells into which the range of a variable is divided, for the spectrum over it."""
KNOTS = 9
EDGE = 0.05
"""Part of the readings that lie before and after a jump at least."""
LEAST = 0.5
"""Share of what a constant leaves that a pattern explains at least, on stretches it was not fitted to."""
VARIES = 0.2
"""Part of it that a constant leaves at least: of an offset with a little tone the tone is not the cause."""
CLEARER = 0.1
"""Share by which it explains more than smooth functions of the measured variables do."""
MOVED = 0.05
"""Share of a motion that a tone makes up, or half or a third of its frequency, from which what swings like
that may come of the motion: a friction under a sine of 1 Hz has tones of 1 and 3 Hz."""

Series = Float[np.ndarray, " rows"]
Basis = Float[np.ndarray, "rows terms"]
Rows = Int[np.ndarray, " rows"]


def residual_pattern(
    missing: MissingRate, rows: Rows, named: Mapping[str, Series], case: Case, by_variables: float
) -> Pattern | None:
    r"""The pattern of a missing rate, if there is one that says more than the measured variables.

    Each of these is fitted to every second of :data:`BLOCKS` stretches of the training rows and judged on the
    others, weighted by the precision of the missing rate:

    .. math:: a + b \cos 2πfs + c \sin 2πfs, \quad a + b\,(t ≥ t_0), \quad \text{lines through knots in } t

    s is the time t or a measured variable; f is where the weighted spectrum over it is highest, t0 where the
    squares left by two means are least.

    Args:
        rows: training rows whose readings count, in the order of time.
        named: measured variables of every row, of which those that are columns may have ripples, beside the
            column that the missing rate is of.
        by_variables: share of the missing rate that smooth functions of them explain.

    Returns:
        of the column of which most is missing, the pattern with the largest share; `None` if that is less
        than :data:`LEAST`, or not :data:`CLEARER` than by variables.
    """
    column = max(missing.values, key=lambda name: float(np.sum(_weighted(missing, name, rows)[0] ** 2)))
    target, weight = _weighted(missing, column, rows)
    over = {column: case.filled.columns[column], **named}  # a sensor errs with what it reads itself
    columns = {name: series[rows] for name, series in over.items() if name in case.recording.columns}
    patterns = [
        *_in_time(target, weight, case.recording.step * rows, _motions(case, rows)),
        *_over_variables(target, weight, columns),
    ]
    found = max(patterns, key=lambda each: each.share)
    if found.share < max(LEAST, by_variables + CLEARER):
        return None
    if found.kind == RIPPLE:
        return dataclasses.replace(found, unit=case.actuator.column(found.variable).unit)
    if found.kind != JUMP or found.at is None:
        return found
    row = rows[np.searchsorted(case.recording.step * rows, found.at)]
    return dataclasses.replace(found, at=float(case.recording.time[row]))


def _weighted(missing: MissingRate, column: str, rows: Rows) -> tuple[Series, Series]:
    """A missing rate over its standard deviation, and one over that."""
    spread = missing.spread[column][rows]
    weight = 1 / np.maximum(spread, np.quantile(spread, 0.05) + 1e-300)
    return missing.values[column][rows] * weight, weight


def _in_time(target: Series, weight: Series, time: Series, motions: list[Series]) -> Iterator[Pattern]:
    """The best pattern of each kind in time; of jump and drift the jump if it explains as much."""
    smooth = share(target, weight, _through_knots(time))
    instant = _instant(target, weight, time)
    jump = share(target, weight, _steps(time, instant))
    yield (
        Pattern(JUMP, "time", instant, "s", jump)
        if jump >= smooth
        else Pattern(DRIFT, "time", None, "s", smooth)
    )
    frequency = highest_line(target, weight, time, float(np.min(np.diff(time))))
    if not any(_swings(motion, frequency / part, time) for motion in motions for part in (1, 2, 3)):
        yield Pattern(TONE, "time", frequency, "Hz", share(target, weight, _swing(time, frequency)))


def _over_variables(target: Series, weight: Series, columns: Mapping[str, Series]) -> Iterator[Pattern]:
    for name, series in columns.items():
        frequency = highest_line(target, weight, series, float(np.ptp(series)) / CELLS)
        yield Pattern(RIPPLE, name, 1 / frequency, "", share(target, weight, _swing(series, frequency)))


def share(target: Series, weight: Series, basis: Basis) -> float:
    """Part of what a constant leaves of `target` that `basis`, whose first term is one, takes away, on
    stretches that it was not fitted to; 0 where the constant leaves less than :data:`VARIES`.
    """
    total, constant, left = _left(target, weight, basis)
    return 1 - left / constant if constant > VARIES * total else 0.0


def _left(target: Series, weight: Series, basis: Basis) -> tuple[float, float, float]:
    """Squares of `target`, what its constant leaves of them where it was not fitted, what `basis` leaves."""
    scaled = basis * weight[:, None]
    fold = np.arange(len(target)) * BLOCKS // len(target) % 2
    left = np.zeros(2)
    for judged in (0, 1):
        fitted, unseen = fold != judged, fold == judged
        for i, terms in enumerate((scaled[:, :1], scaled)):
            values = np.linalg.lstsq(terms[fitted], target[fitted], rcond=None)[0]
            left[i] += float(np.sum((target[unseen] - terms[unseen] @ values) ** 2))
    return max(float(np.sum(target**2)), 1e-300), float(left[0]), float(left[1])


def highest_line(target: Series, weight: Series, axis: Series, cell: float) -> float:
    """Frequency of the highest line of the weighted spectrum over `axis`, from :data:`PERIODS` periods on.

    Args:
        axis: time, or a variable; in any order.
        cell: width of the cells into which it is sorted, of which a period has two at least.
    """
    level = float(np.sum(target * weight) / np.sum(weight**2))
    places = np.round((axis - axis.min()) / cell).astype(int)
    line = np.bincount(places, weight * (target - level * weight), 4 * (int(places.max()) + 1))
    power = np.abs(np.fft.rfft(line)) ** 2
    frequencies = np.fft.rfftfreq(len(line), cell)
    slowest = PERIODS / float(np.ptp(axis))
    power[frequencies < slowest] = 0.0
    rough, width = float(frequencies[power.argmax()]), float(frequencies[1])

    def left(frequency: float) -> float:
        scaled = _swing(axis, frequency) * weight[:, None]
        values = np.linalg.lstsq(scaled, target, rcond=None)[0]
        return float(np.sum((target - scaled @ values) ** 2))

    near = minimize_scalar(left, bounds=(max(rough - width, slowest), rough + width), method="bounded")
    return float(near.x)


def _swing(axis: Series, frequency: float) -> Basis:
    angle = 2 * np.pi * frequency * axis
    return np.stack([np.ones_like(axis), np.cos(angle), np.sin(angle)], axis=1)


def _swings(motion: Series, frequency: float, time: Series) -> bool:
    """Whether a motion has a tone of this frequency itself."""
    basis, moved = _swing(time, frequency), motion - motion.mean()
    values = np.linalg.lstsq(basis, moved, rcond=None)[0]
    return float(np.sum((basis @ values) ** 2)) > MOVED * float(np.sum(moved**2))


def _motions(case: Case, rows: Rows) -> list[Series]:
    """What drives the machine: its commands, and what the bench imposes."""
    actuator = case.actuator
    imposed = (name for state in actuator.imposed for name in actuator.measured.get(state, ()))
    return [case.filled.columns[name][rows] for name in (*actuator.commands, *imposed)]


def _instant(target: Series, weight: Series, time: Series) -> float:
    """The instant before and after which means leave least [s]."""
    moments, squares = np.cumsum(target * weight), np.cumsum(weight**2)
    removed = moments**2 / squares + (moments[-1] - moments) ** 2 / np.maximum(squares[-1] - squares, 1e-300)
    margin = max(int(EDGE * len(time)), 1)
    return float(time[margin + int(removed[margin : -margin - 1].argmax()) + 1])


def _steps(time: Series, instant: float) -> Basis:
    return np.stack([np.ones_like(time), time >= instant], axis=1)


def _through_knots(time: Series) -> Basis:
    knots = np.linspace(time[0], time[-1], KNOTS)
    hats = [np.interp(time, knots, unit) for unit in np.eye(KNOTS)[1:]]
    return np.stack([np.ones_like(time), *hats], axis=1)
