"""A recording: what a bench measured, in SI, on a uniform clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.units import Series


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """Samples of all quantities of a card. Values are SI, pressures absolute.

    Attributes:
        name: stem of the file, or a name given.
        file, sha256: the table that was read and its checksum, `None` for a recording made in memory.
        card: how it was made.
        time: sampling instants [s], starting as in the file.
        step: sampling step [s].
        columns: quantity as in the card ("command", "pressure_1", …) → samples. The command of a sample
            acts until the next one; sensors are read at the sample.
        breaks: rows at which a new run begins, with everything that is not measured at rest.
    """

    name: str
    file: Path | None
    sha256: str | None
    card: Card
    time: Series = dataclasses.field(repr=False)
    step: float
    columns: dict[str, Series] = dataclasses.field(repr=False)
    breaks: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Hold all columns to one length."""
        for name, values in self.columns.items():
            if values.shape != self.time.shape:
                raise ValueError(f"{name}: expected the shape of time, {self.time.shape}; got {values.shape}")

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    def part(self, start: int | None, stop: int | None) -> Recording:
        """The samples from `start` up to, not including, `stop`, counted as in a slice."""
        rows = slice(start, stop)
        first, last, _ = rows.indices(len(self))
        columns = {name: values[rows] for name, values in self.columns.items()}
        breaks = tuple(row - first for row in self.breaks if first < row < last)
        return dataclasses.replace(self, time=self.time[rows], columns=columns, breaks=breaks)


def joined(recordings: Sequence[Recording], name: str) -> Recording:
    """Runs of one bench under one card, one after the other, as one recording with breaks.

    Raises:
        ValueError: no recording, or sampling steps that differ by more than 1 %.
    """
    if not recordings:
        raise ValueError("expected at least one recording to join")
    first, rows = recordings[0], np.cumsum([len(recording) for recording in recordings])
    if any(abs(recording.step - first.step) > 0.01 * first.step for recording in recordings):
        raise ValueError(f"expected one sampling step; got {[recording.step for recording in recordings]}")
    inner = [row + b for r, row in zip(recordings, [0, *rows[:-1]], strict=True) for b in r.breaks]
    return dataclasses.replace(
        first,
        name=name,
        time=first.time[0] + first.step * np.arange(rows[-1]),
        columns={q: np.concatenate([r.columns[q] for r in recordings]) for q in first.columns},
        breaks=tuple(sorted({*map(int, inner), *map(int, rows[:-1])})),
    )
