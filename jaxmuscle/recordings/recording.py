"""Recording: what was measured, in SI, on a uniform clock."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.formatting import aligned, estimate, join, printed_unit, quantity, rounded, words
from jaxmuscle.notebook_html import Sparkline, Table, View
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_rows import Rows
from jaxmuscle.recordings.schema import Need, Quantity
from jaxmuscle.units import Series

COLUMN_HEADS = ("", "from", "to", "noise", "missing")
"""What is shown of a column."""


@dataclasses.dataclass(frozen=True)
class Member:
    """One of several recordings that were joined.

    Attributes:
        name: what results call it.
        file, sha256: the table that was read and its checksum, `None` for one made in memory.
        first, rows: its first row in the whole, and how many it has.
        begin, step: its own time at that row, and its own sampling step [s].
        left_out: which of its rows were taken and why, a sentence, when they are not all.
    """

    name: str
    file: Path | None
    sha256: str | None
    first: int
    rows: int
    begin: float
    step: float
    left_out: str = ""


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
        ignored: column → rows whose reading counts for nothing, as the card says.
        held_out: rows that no fit of a diagnosis sees, as the card says; `None` where it names none.
        joined_from: the recordings that it was joined from; empty for a single one.
        left_out: which rows were taken and why, a sentence, when they are not all.
        differences: quantity of the card → by how much its value at a row is above the card's (SI), where
            recordings under several values were joined.
    """

    name: str
    file: Path | None
    sha256: str | None
    card: Card
    time: Series = dataclasses.field(repr=False)
    step: float
    columns: dict[str, Series] = dataclasses.field(repr=False)
    breaks: tuple[int, ...] = ()
    ignored: Mapping[str, Rows] = dataclasses.field(default_factory=dict, repr=False)
    held_out: Rows | None = dataclasses.field(default=None, repr=False)
    joined_from: tuple[Member, ...] = dataclasses.field(default=(), repr=False)
    left_out: str = ""
    differences: Mapping[str, Series] = dataclasses.field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        """Hold all columns to one length."""
        for name, values in self.columns.items():
            if values.shape != self.time.shape:
                raise ValueError(f"{name}: expected the shape of time, {self.time.shape}; got {values.shape}")

    def _repr_html_(self) -> str:
        """What a notebook shows: every column with its range and course, and what the card says."""
        return _view(self).html()

    def __repr__(self) -> str:
        """What a terminal shows: every column with its range, and what the card leaves open."""
        return _summary(self)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def members(self) -> tuple[Member, ...]:
        """The recordings that it was joined from, or itself."""
        alone = Member(
            self.name, self.file, self.sha256, 0, len(self), float(self.time[0]), self.step, self.left_out
        )
        return self.joined_from or (alone,)

    def differing(self, member: Member) -> dict[str, float]:
        """Values (SI) that are not the card's in all members, as they are in one."""
        given = self.card.quantities
        return {
            name: given[name].value + float(by[member.first])
            for name, by in self.differences.items()
            if by.any()
        }

    def part(self, start: int | None, stop: int | None) -> Recording:
        """The samples from `start` up to, not including, `stop`, counted as in a slice."""
        rows = slice(start, stop)
        first, last, _ = rows.indices(len(self))
        columns = {name: values[rows] for name, values in self.columns.items()}
        breaks = tuple(row - first for row in self.breaks if first < row < last)
        return dataclasses.replace(
            self,
            time=self.time[rows],
            columns=columns,
            breaks=breaks,
            ignored={name: bad[rows] for name, bad in self.ignored.items()},
            held_out=None if self.held_out is None else self.held_out[rows],
            differences={name: by[rows] for name, by in self.differences.items()},
            joined_from=tuple(
                _within(member, first, last)
                for member in self.joined_from
                if member.first < last and member.first + member.rows > first
            ),
        )


def _within(member: Member, first: int, last: int) -> Member:
    """What of a member lies between two rows of the whole, counted from the first of them."""
    begin, end = max(member.first, first), min(member.first + member.rows, last)
    time = member.begin + member.step * (begin - member.first)
    return dataclasses.replace(member, first=begin - first, rows=end - begin, begin=time)


def _facts(recording: Recording) -> list[str]:
    sampled = f"{len(recording)} samples at {1 / recording.step:.4g} Hz"
    runs = [f"{len(recording.breaks) + 1} runs"] if recording.breaks else []
    return [f"rig {recording.card.rig}", sampled, *runs]


def _summary(recording: Recording) -> str:
    card, units = recording.card, {key: need.unit for key, need in _needs(recording.card).items()}
    columns = [COLUMN_HEADS] + [
        tuple(str(cell) for cell in _column_row(key, values, units.get(key, ""), card.noise.get(key))[:-1])
        for key, values in recording.columns.items()
    ]
    told = [i for i in range(len(COLUMN_HEADS)) if any(row[i] for row in columns[1:])]
    heads, *rows = [[row[i] for i in told] for row in columns]
    fitted = [
        f"{words(key)} {estimate(entry.value, entry.std, units.get(key, ''))}"
        for key, entry in card.uncertain.items()
        if entry.std is not None
    ]
    return "\n".join(
        [
            f"{recording.name}: {', '.join(_facts(recording))}",
            aligned(heads, rows),
            *(["pressures are absolute"] if "Pa" in units.values() else []),
            *([f"to be fitted: {', '.join(fitted)}"] if fitted else []),
            *(
                [f"effects that the card declares: {', '.join(map(words, card.effects))}"]
                if card.effects
                else []
            ),
            *([recording.left_out] if recording.left_out else []),
        ]
    )


def _view(recording: Recording) -> View:
    card, facts = recording.card, _facts(recording)
    facts += [recording.file.name] if recording.file and not recording.joined_from else []
    facts += [member.name for member in recording.joined_from]
    units = {key: need.unit for key, need in _needs(card).items()}
    columns = [
        _column_row(key, values, units.get(key, ""), card.noise.get(key))
        for key, values in recording.columns.items()
    ]
    given = [
        (words(key), _given(recording, key, entry, units.get(key, "")))
        for key, entry in (*card.uncertain.items(), *card.known.items())
    ]
    effects = [(words(name), ", ".join(map(words, entries))) for name, entries in card.effects.items()]
    return View(
        "recording",
        recording.name,
        facts,
        lead=[text for text in (card.description, recording.left_out) if text],
        tables=[
            Table(
                "columns (pressures absolute)" if "Pa" in units.values() else "columns",
                (*COLUMN_HEADS, ""),
                columns,
            ),
            Table("card", ("", "value"), given, open=False),
            Table("effects that the card declares", ("", "parameters"), effects, open=False),
        ],
    )


def _given(recording: Recording, key: str, entry: Quantity, unit: str) -> str:
    """A value of the card, one for each member where these differ."""
    std = math.nan if entry.std is None else entry.std
    each = [recording.differing(member).get(key, entry.value) for member in recording.members]
    return ", ".join(estimate(value, std, unit) for value in dict.fromkeys(each))


def _needs(card: Card) -> Mapping[str, Need]:
    """Column and quantity of the card → its SI unit; nothing for a rig that is not registered."""
    rig = RIGS.get(card.rig)
    return {} if rig is None else {**schema.quantities(rig), **schema.columns(rig)}


def _column_row(key: str, values: Series, unit: str, noise: float | None) -> tuple[object, ...]:
    finite = values[np.isfinite(values)]
    ends = (float(finite.min()), float(finite.max())) if len(finite) else (math.nan, math.nan)
    size, printed = printed_unit(unit, float(np.abs(finite).max(initial=0.0)))
    shown = [join(rounded(end / size, 4), printed) if len(finite) else "" for end in ends]
    missing = len(values) - len(finite)
    told = "" if noise is None else quantity(noise, unit)
    return words(key), *shown, told, str(missing) if missing else "", Sparkline(values)
