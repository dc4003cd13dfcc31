"""Missing data: readings that are not there (NaN), segments that the user excludes, short gaps bridged."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import raised
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.smoothing import quantisation_step
from jaxmuscle.simulation.observed import differences_by_path

Values = NDArray[np.float64]
Rows = NDArray[np.bool_]

LONGEST_BRIDGE = 20
"""Samples of a measured state in a row that are bridged by a curve; a longer gap ends a window."""
BESIDE, SHARE = 2, 4
"""Readings on each side that a curve goes by: two, and one more for so many samples of the gap."""
OVERSHOOT = 1.0
"""How far a curve may go beyond these readings, in parts of their range: the top of a wave goes up to 0.8."""
BEYOND = 5.0
"""Standard deviations of its sensor beyond a stop from which a machine is taken to be there."""
STENCILS = 100
"""Stencils from which the noise can be told to a tenth."""


def bridged(values: Values, bad: Rows, breaks: Sequence[int] = ()) -> Values:
    """The column with each gap bridged by a cubic through the readings beside it, least squares if there are
    more than two on a side.

    A straight line would cut the tops off, all to the same side: a bias in what depends on the column. Longer
    gaps than `LONGEST_BRIDGE` are bridged by a line, which nothing depends on, and at its ends a run is held.
    A break is not bridged across.
    """
    filled, rows = values.astype(np.float64), np.arange(len(values))
    good = np.flatnonzero(~bad)
    filled[bad] = np.interp(rows[bad], good, values[good]) if good.size else 0.0
    for begin, end in itertools.pairwise((0, *breaks, len(values))):
        own = begin + np.flatnonzero(~bad[begin:end])
        if not own.size:
            continue
        outside = np.concatenate([np.arange(begin, own[0]), np.arange(own[-1] + 1, end)])
        filled[outside] = np.interp(outside, own, values[own])
        for before in np.flatnonzero(np.diff(own) > 1):
            gap = np.arange(own[before] + 1, own[before + 1])
            filled[gap] = _across(values, own, int(before), gap)
    return filled


def _across(values: Values, own: NDArray[np.intp], before: int, gap: NDArray[np.intp]) -> Values:
    """The curve across one gap, which lies behind reading number `before` of a run's `own`."""
    many = BESIDE + len(gap) // SHARE if len(gap) <= LONGEST_BRIDGE else 1
    many = min(many, before + 1, len(own) - before - 1)
    beside = own[before + 1 - many : before + 1 + many]
    middle, size = gap.mean(), 0.5 * float(np.ptp(beside))
    degree = min(3, 2 * many - 1)
    powers = np.vander((beside - middle) / size, degree + 1)
    curve = np.vander((gap - middle) / size, degree + 1) @ np.linalg.lstsq(powers, values[beside])[0]
    low, high = values[beside].min(), values[beside].max()
    more = OVERSHOOT * (high - low)
    return np.clip(curve, low - more, high + more).astype(np.float64)


def noise_beside_gaps(values: Values, bad: Rows, breaks: Sequence[int] = ()) -> float:
    """Standard deviation of the white noise on a smooth signal, from its readings only.

    By fourth differences, as :func:`jaxmuscle.recordings.smoothing.noise_level`, where five readings follow
    each other; bridged gaps are smoother than any reading and would make little of the noise. Where these are
    too few, by fourth divided differences of five readings with gaps between them, the narrowest first, each
    in units of its own standard deviation. Not below that of a converter's steps. Zero for fewer than five
    readings.
    """
    signs, widths = [np.zeros(0)], [np.zeros(0)]
    for begin, end in itertools.pairwise((0, *breaks, len(values))):
        own = begin + np.flatnonzero(~bad[begin:end])
        if len(own) < 5:
            continue
        at = np.lib.stride_tricks.sliding_window_view(own, 5).astype(np.float64)
        apart = at[:, :, None] - at[:, None, :] + np.eye(5)
        weights = 1 / apart.prod(axis=2)
        size = np.linalg.norm(weights, axis=1)
        signs.append((weights * values[at.astype(np.intp)]).sum(axis=1) / size)
        widths.append(1 / size)
    differences, width = np.concatenate(signs), np.concatenate(widths)
    if not len(width):
        return 0.0
    widest = np.sort(width)[min(STENCILS, len(width)) - 1]
    kept = differences[width <= widest * (1 + 1e-9)]
    spread = 1.4826 * np.median(np.abs(kept - np.median(kept)))
    return float(max(spread, quantisation_step(values[~bad]) / np.sqrt(12.0)))


Mask = ArrayLike | Mapping[str, ArrayLike]

LEAST_ROWS = 50
"""Usable readings of each output without which nothing is fitted."""


@dataclasses.dataclass(frozen=True)
class Usable:
    """A recording without gaps, and what of it counts.

    Attributes:
        recording: every unusable reading replaced, see :func:`jaxmuscle.estimation.missing_data.bridged`.
        good: column of a sensor → rows with a reading that counts.
        ignored: output → column by column, rows whose residual does not count.
        cut: rows within long gaps of a measured state, or beyond a stop: no window begins or runs on there.
    """

    recording: Recording
    good: dict[str, Rows]
    ignored: dict[str, Rows]
    cut: Rows


def usable(actuator: AbstractActuator, recording: Recording, mask: Mask | None) -> Usable:
    """Find out which samples of `recording` can be used.

    Args:
        mask: rows that are bad: one boolean array for all columns, or column → boolean array. Those that the
            recording's card wants to be ignored are bad without it.

    Raises:
        InputError: a mask of the wrong length or for an unknown column, a missing command, too little left.
    """
    bad = _bad(actuator, recording, mask)
    if nothing := [column for column, rows in bad.items() if rows.all()]:
        raise InputError(
            f"recording {recording.name!r}: column {nothing[0]!r} has no usable reading; a fit needs all "
            f"that its rig measures. Mask less, or leave the recording out"
        )
    filled = {
        name: bridged(values, bad[name], recording.breaks) if name in bad else values
        for name, values in recording.columns.items()
    }
    states = {column for group in actuator.measured.values() for column in group}
    imposed = {column for state in actuator.imposed for column in actuator.measured.get(state, ())}
    cut = np.zeros(len(recording), dtype=bool)
    for column in states & bad.keys():
        cut |= _long_runs(bad[column], LONGEST_BRIDGE)
    for column, rows in beyond_stops(actuator, recording).items():
        bad[column] = bad.get(column, np.zeros(len(recording), dtype=bool)) | rows
        cut |= rows
    without_input = np.zeros(len(recording), dtype=bool)
    for column in imposed & bad.keys():
        without_input |= bad[column]
    none = np.zeros(len(recording), dtype=bool)
    ignored = {
        out: np.stack([bad.get(name, none) | without_input for name in names], axis=-1)
        for out, names in actuator.outputs.items()
    }
    for out, rows in ignored.items():
        left = int((~(rows | cut[:, None])).all(axis=-1).sum())
        if left < LEAST_ROWS:
            raise InputError(
                f"recording {recording.name!r}: only {left} usable samples of {out} are left of "
                f"{len(recording)}; expected at least {LEAST_ROWS}. Mask less, or leave the recording out"
            )
    good = {column: ~bad.get(column, none) for column in measured_columns(actuator)}
    return Usable(_with_columns(recording, filled), good, ignored, cut)


def beyond_stops(actuator: AbstractActuator, recording: Recording) -> dict[str, Rows]:
    """Column → rows where a machine went beyond what its model allows, if any.

    A joint between two muscles ends where one of them has its full length; one that was seen beyond has
    stretched a muscle or left its sprocket. No window runs on there: the model would stay at its stop, and
    however right it is elsewhere, the error of that stretch would outweigh all others.
    """
    found: dict[str, Rows] = {}
    every = np.arange(len(recording))
    # Between joined recordings, where a length may differ, the ends may too.
    edges = (0, *(recording.breaks if recording.differences else ()), len(recording))
    for first, end in itertools.pairwise(edges):
        by = {path: values[first] for path, values in differences_by_path(actuator, recording).items()}
        for state, ends in raised(actuator, by).stops.items():
            columns = actuator.measured.get(state, ())
            for column, lowest, highest in zip(
                columns, *(np.broadcast_to(np.asarray(each), len(columns)) for each in ends), strict=True
            ):
                values = recording.columns[column]
                noise = recording.card.noise.get(column) or noise_beside_gaps(values, ~np.isfinite(values))
                rows = (values < lowest - BEYOND * noise) | (values > highest + BEYOND * noise)
                rows &= (every >= first) & (every < end)
                if rows.any():
                    found[column] = found.get(column, False) | rows
    return found


def noise_of_readings(
    actuator: AbstractActuator, recording: Recording, mask: Mask | None
) -> dict[str, float]:
    """Column → noise of those sensors that miss readings and of which the card tells none (SI).

    Args:
        mask: as for :func:`usable`.
    """
    return {
        column: noise_beside_gaps(recording.columns[column], rows, recording.breaks)
        for column, rows in _bad(actuator, recording, mask).items()
        if not recording.card.noise.get(column)
    }


def _bad(actuator: AbstractActuator, recording: Recording, mask: Mask | None) -> dict[str, Rows]:
    sensors = measured_columns(actuator)
    masks = mask if isinstance(mask, Mapping) else {} if mask is None else dict.fromkeys(sensors, mask)
    for column in masks:
        if column not in sensors:
            raise InputError(
                f"masks: recording {recording.name!r} has no sensor {column!r}{nearest(column, sensors)}"
            )
    for column in actuator.commands:
        missing = np.flatnonzero(~np.isfinite(recording.columns[column]))
        if missing.size:
            more = f" and {missing.size - 1} others" if missing.size > 1 else ""
            raise InputError(
                f"recording {recording.name!r}: the command {column!r} is not a number in row {missing[0]}"
                f"{more}; a command acts on all that follows. "
                f" Fill it with what was commanded, or cut the recording there"
            )
    bad = {}
    for column in sensors:
        rows = ~np.isfinite(recording.columns[column])
        if column in recording.ignored:
            rows = rows | recording.ignored[column]
        if column in masks:
            rows = rows | _checked(masks[column], recording, column)
        if rows.any():
            bad[column] = rows
    return bad


def _checked(mask: ArrayLike, recording: Recording, column: str) -> Rows:
    rows = np.asarray(mask)
    if rows.dtype != bool or rows.shape != (len(recording),):
        raise InputError(
            f"masks: expected one boolean for each of the {len(recording)} rows of recording "
            f"{recording.name!r} ({column}), true where it is bad; got {rows.dtype} of shape {rows.shape}"
        )
    return rows


def _long_runs(bad: Rows, longest: int) -> Rows:
    """The runs of bad rows that are longer than `longest`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(int), [0]])))
    long = np.zeros(len(bad), dtype=bool)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        if end - first > longest:
            long[first:end] = True
    return long


def _with_columns(recording: Recording, filled: dict[str, NDArray[np.float64]]) -> Recording:
    return dataclasses.replace(recording, columns=filled)
