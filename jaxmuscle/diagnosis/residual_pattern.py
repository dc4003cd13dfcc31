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

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.diagnosis_data import DRIFT, JUMP, RIPPLE, TONE, Pattern
from jaxmuscle.diagnosis.evidence import blocks
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import Evaluated
from jaxmuscle.estimation.windows import Problem

BLOCKS = 20
"""Stretches of the recording, by turns fitted and judged."""
PERIODS = 3.0
"""Periods of a tone or a ripple that there are at least: fewer are a drift, or a smooth dependence."""
CELLS = 256
"""Cells into which the range of a variable is divided, for the spectrum over it."""
KNOTS = 9
"""Of a drift, over the length of the recording: what changes faster is none."""
FEWEST = 100
"""Readings below which no pattern is looked for."""
EDGE = 0.05
"""Part of the readings that lie before and after a jump at least."""
LEAST = {TONE: 0.3, RIPPLE: 0.3, JUMP: 0.5, DRIFT: 0.5}
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
Table = Float[np.ndarray, "rows *terms"]
Rows = Int[np.ndarray, " rows"]


@dataclasses.dataclass(frozen=True)
class Residual:
    """What a model leaves of a column, reading by reading in the order of windows.

    Attributes:
        column: its name.
        values: predicted less measured, in units of the noise.
        rows: of the recording.
        parts: number of the part of a window, predicted from the measured state, that each belongs to.
        grown: whether it builds up along a part, as an error of what is integrated does.
    """

    column: str
    values: Series
    rows: Rows
    parts: Rows
    grown: bool


def left_by(model: AbstractActuator, residuals: Evaluated, problem: Problem, output: str) -> Residual:
    """The residual of the column of an output of which a model leaves most.

    Args:
        residuals: weighted, of the windows of `problem`.
    """
    layout = ResidualLayout.of(model, problem)
    values, weights = (layout.table(output, each[output]) for each in (residuals, problem.weights))
    chosen = int(np.nansum(values**2, axis=(0, 1)).argmax())
    counts = (weights[..., chosen] > 0) & np.isfinite(values[..., chosen])
    windows, samples = layout.rows.shape
    parts = blocks(windows, samples, int(problem.period))
    return Residual(
        layout.columns[output][chosen],
        values[..., chosen][counts],
        layout.rows[counts],
        parts[counts],
        output in model.measured and output not in model.imposed,
    )


def residual_pattern(
    left: Residual, named: Mapping[str, Series], case: Case, by_variables: float
) -> Pattern | None:
    r"""The pattern of a residual, if there is one that says more than the measured variables.

    Each of these is fitted to every second of :data:`BLOCKS` stretches and judged on the others:

    .. math:: a + b \cos 2πfs + c \sin 2πfs, \quad a + b\,(t ≥ t_0), \quad \text{lines through knots in } t

    s is the time t or a measured variable; f is where the spectrum over it is highest, t0 where the squares
    left by two means are least. Where errors build up along a part of a window, from the measured state,
    tones and ripples are those beside a line of its own for every part.

    Args:
        named: measured variables at every row of the recording, of which columns may have ripples, beside
            the column of the residual.
        by_variables: share of the missing rate that smooth functions of them explain.

    Returns:
        the pattern with the largest share; `None` if that is less than :data:`LEAST`, or not
        :data:`CLEARER` than by variables, or there are too few readings.
    """
    if len(left.values) < FEWEST:
        return None
    over = {left.column: case.filled.columns[left.column], **named}  # a sensor errs with what it reads itself
    columns = {name: series[left.rows] for name, series in over.items() if name in case.recording.columns}
    patterns = [*_in_time(left, case), *_over_variables(left, columns)]
    found = max(patterns, key=lambda each: each.share)
    if found.share < max(LEAST[found.kind], by_variables + CLEARER):
        return None
    if found.kind == RIPPLE:
        return dataclasses.replace(found, unit=case.actuator.column(found.variable).unit)
    return found


def _in_time(left: Residual, case: Case) -> Iterator[Pattern]:
    """The best pattern of each kind in time; of jump and drift the jump if it explains as much."""
    time = case.recording.step * left.rows
    smooth = share(left.values, _through_knots(time))
    row = _jump(left)
    jump = share(left.values, _steps(left.rows, row))
    if jump >= smooth:
        yield Pattern(JUMP, "time", float(case.recording.time[row]), "s", jump)
    else:
        yield Pattern(DRIFT, "time", None, "s", smooth)
    frequency = highest_line(left, time, case.recording.step)
    motions = [series[left.rows] for series in _motions(case)]
    if not any(_swings(motion, frequency / part, time) for motion in motions for part in (1, 2, 3)):
        yield Pattern(TONE, "time", frequency, "Hz", _share_of_swing(left, time, frequency))


def _over_variables(left: Residual, columns: Mapping[str, Series]) -> Iterator[Pattern]:
    for name, series in columns.items():
        if np.ptp(series) == 0:
            continue
        frequency = highest_line(left, series, float(np.ptp(series)) / CELLS)
        yield Pattern(RIPPLE, name, 1 / frequency, "", _share_of_swing(left, series, frequency))


def _share_of_swing(left: Residual, axis: Series, frequency: float) -> float:
    return share(_beside_lines(left, left.values), _beside_lines(left, _swing(axis, frequency)))


def share(target: Series, basis: Basis) -> float:
    """Part of what a constant leaves of `target` that `basis` takes away beside one, on stretches that it was
    not fitted to; 0 where the constant leaves less than :data:`VARIES`.
    """
    fold = np.arange(len(target)) * BLOCKS // len(target) % 2
    constant = np.ones((len(target), 1))
    left = np.zeros(2)
    for judged in (0, 1):
        fitted, unseen = fold != judged, fold == judged
        for i, terms in enumerate((constant, np.hstack([constant, basis]))):
            values = np.linalg.lstsq(terms[fitted], target[fitted], rcond=None)[0]
            left[i] += float(np.sum((target[unseen] - terms[unseen] @ values) ** 2))
    return float(1 - left[1] / left[0]) if left[0] > VARIES * float(np.sum(target**2)) else 0.0


def _beside_lines(left: Residual, values: Table) -> Table:
    """Values less a line through each part of a window, where the residual is one that builds up."""
    if not left.grown:
        return values
    _, part = np.unique(left.parts, return_inverse=True)
    count = np.bincount(part)

    def mean(of: Series) -> Series:
        return (np.bincount(part, of) / count)[part]

    way = left.rows - mean(left.rows)
    length = np.maximum(mean(way**2), 1e-300)

    def levelled(each: Series) -> Series:
        return each - mean(each) - way * mean(way * each) / length

    return np.apply_along_axis(levelled, 0, values)


def highest_line(left: Residual, axis: Series, cell: float) -> float:
    """Frequency of the highest line of a residual's spectrum over `axis`, from :data:`PERIODS` periods on.

    Args:
        axis: time, or a variable; in any order.
        cell: width of the cells into which it is sorted, of which a period has two at least.
    """
    target = _beside_lines(left, left.values)
    target = target - target.mean()
    places = np.round((axis - axis.min()) / cell).astype(int)
    line = np.bincount(places, target, 4 * (int(places.max()) + 1))
    power = np.abs(np.fft.rfft(line)) ** 2
    frequencies = np.fft.rfftfreq(len(line), cell)
    slowest = PERIODS / float(np.ptp(axis))
    power[frequencies < slowest] = -1.0
    rough, width = float(frequencies[power.argmax()]), float(frequencies[1])

    def missed(frequency: float) -> float:
        basis = _beside_lines(left, _swing(axis, frequency))
        values = np.linalg.lstsq(basis, target, rcond=None)[0]
        return float(np.sum((target - basis @ values) ** 2))

    near = minimize_scalar(missed, bounds=(max(rough - width, slowest), rough + width), method="bounded")
    return float(near.x)


def _swing(axis: Series, frequency: float) -> Basis:
    angle = 2 * np.pi * frequency * axis
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _swings(motion: Series, frequency: float, time: Series) -> bool:
    """Whether a motion has a tone of this frequency itself."""
    basis, moved = _swing(time, frequency), motion - motion.mean()
    values = np.linalg.lstsq(basis, moved, rcond=None)[0]
    return float(np.sum((basis @ values) ** 2)) > MOVED * float(np.sum(moved**2))


def _motions(case: Case) -> list[Series]:
    """What drives the machine: its commands, and what the bench imposes."""
    actuator = case.actuator
    imposed = (name for state in actuator.imposed for name in actuator.measured.get(state, ()))
    return [case.filled.columns[name] for name in (*actuator.commands, *imposed)]


def _jump(left: Residual) -> int:
    """The row before and after which means leave least."""
    moments, count = np.cumsum(left.values), np.arange(1, len(left.values) + 1)
    others = np.maximum(count[-1] - count, 1)
    removed = moments**2 / count + (moments[-1] - moments) ** 2 / others
    margin = max(int(EDGE * len(count)), 1)
    return int(left.rows[margin + int(removed[margin : -margin - 1].argmax()) + 1])


def _steps(rows: Rows, row: int) -> Basis:
    return (rows >= row).astype(float)[:, None]


def _through_knots(time: Series) -> Basis:
    knots = np.linspace(time[0], time[-1], KNOTS)
    return np.stack([np.interp(time, knots, unit) for unit in np.eye(KNOTS)[1:]], axis=1)
