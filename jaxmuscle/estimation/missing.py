"""Samples that cannot be used: missing readings (NaN) and stretches that the user calls bad."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.bridged import LONGEST_BRIDGE, bridged, noise_beside_gaps
from jaxmuscle.estimation.names import columns
from jaxmuscle.recordings.recording import Recording

Rows = NDArray[np.bool_]
Mask = ArrayLike | Mapping[str, ArrayLike]

LEAST_ROWS = 50
"""Usable readings of each output without which nothing is fitted."""


@dataclasses.dataclass(frozen=True)
class Usable:
    """A recording without gaps, and what of it counts.

    Attributes:
        recording: every unusable reading replaced, see :func:`jaxmuscle.estimation.bridged.bridged`.
        ignored: output → column by column, rows whose residual does not count.
        cut: rows within long gaps of a measured state: no window begins or runs on there.
    """

    recording: Recording
    ignored: dict[str, Rows]
    cut: Rows


def usable(actuator: AbstractActuator, recording: Recording, mask: Mask | None) -> Usable:
    """Find out which samples of `recording` can be used.

    Args:
        mask: rows that are bad: one boolean array for all columns, or column → boolean array.

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
    return Usable(_with_columns(recording, filled), ignored, cut)


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
    sensors = columns(actuator)
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
