"""Recording: what was measured, in SI, on a uniform clock; from a table or from arrays in memory."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import ArrayLike

from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.formatting import estimate, join, printed_unit, quantity, rounded, words
from jaxmuscle.notebook_html import Sparkline, Table, View
from jaxmuscle.parameters import get
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_rows import Rows
from jaxmuscle.recordings.plausibility import check_machine
from jaxmuscle.recordings.row_selection import LongRecording, RowRequest, request_of, selected, stretch_of
from jaxmuscle.recordings.schema import ColumnSpec, Need, Quantity
from jaxmuscle.units import Series


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

    def __post_init__(self) -> None:
        """Hold all columns to one length."""
        for name, values in self.columns.items():
            if values.shape != self.time.shape:
                raise ValueError(f"{name}: expected the shape of time, {self.time.shape}; got {values.shape}")

    def _repr_html_(self) -> str:
        """What a notebook shows: every column with its range and course, and what the card says."""
        return _view(self).html()

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


def _view(recording: Recording) -> View:
    card, rate = recording.card, 1 / recording.step
    facts = [f"rig {card.rig}", f"{len(recording)} samples at {rate:.4g} Hz"]
    facts += [f"{len(recording.breaks) + 1} runs"] if recording.breaks else []
    facts += [recording.file.name] if recording.file and not recording.joined_from else []
    facts += [member.name for member in recording.joined_from]
    units = {key: need.unit for key, need in _needs(card).items()}
    columns = [
        _column_row(key, values, units.get(key, ""), card.noise.get(key))
        for key, values in recording.columns.items()
    ]
    given = [
        (words(key), estimate(entry.value, math.nan if entry.std is None else entry.std, units.get(key, "")))
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
                ("", "from", "to", "noise", "missing", ""),
                columns,
            ),
            Table("card", ("", "value"), given, open=False),
            Table("effects that the card declares", ("", "parameters"), effects, open=False),
        ],
    )


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


def recording(
    actuator: AbstractActuator,
    columns: Mapping[str, ArrayLike] | pd.DataFrame | xr.Dataset,
    step: float,
    *,
    noise: Mapping[str, float] | None = None,
    horizon: float | None = None,
    breaks: Sequence[int] = (),
    name: str = "recording",
    uncertain: Mapping[str, float] | None = None,
    stretch: str | Sequence[float] | None = None,
    every: int | None = None,
) -> Recording:
    """What a bench measured, from arrays in SI units (pressures absolute) on a uniform clock.

    Its card says what `actuator` says: every quantity is known but those of `uncertain`, which a diagnosis
    and a fit move; a fit also moves what ``free=`` names. The class of the actuator need not be one of the
    package. Effects of the actuator stand in no card: a diagnosis begins without them.

    Args:
        actuator: the machine; its class says which columns there have to be.
        columns: command(s) and measured quantities → samples, all of one length; readings may be NaN. A
            DataFrame or Dataset of such columns too; one in other units goes with a card to
            :func:`jaxmuscle.read`.
        step: sampling step [s].
        noise: column → standard deviation of its sensor (SI); found in the data where not given.
        horizon: length of the windows of prediction [s]; whole runs when `None`.
        breaks: rows at which a new run begins, with everything that is not measured at rest.
        name: what results call it.
        uncertain: quantity of the card → standard deviation of what is known of it (SI).
        stretch, every: which rows to take, as of :func:`jaxmuscle.read`; what is taken of arrays of more
            than :data:`~jaxmuscle.recordings.row_selection.MOST_ROWS` rows is told by a warning.

    Raises:
        InputError: columns that are missing, unknown or of unequal length; a step, noise, horizon or break
            that cannot be; samples that cannot be of this machine (a reversed sign, a wrong unit).
    """
    rig = type(actuator)
    needs = {key: need for key, need in schema.columns(rig).items() if key != "time"}
    for where, given in (("columns", columns), ("noise", noise or {}), ("uncertain", uncertain or {})):
        if not isinstance(given, Mapping | pd.DataFrame | xr.Dataset):
            raise InputError(
                f"{where}: expected a mapping of names, such as {{'pressure': …}}; got {given!r}"
            )
        for key in given if where != "uncertain" else ():
            if key not in needs:
                raise InputError(f"{where}: unknown column {key!r}{nearest(str(key), needs)}")
    if missing := [key for key in needs if key not in columns]:
        raise InputError(f"columns: {', '.join(missing)} missing; rig {rig.rig!r} has {', '.join(needs)}")
    arrays = {key: _samples(columns[key], key) for key in needs}
    shapes = {key: values.shape for key, values in arrays.items()}
    if len(set(shapes.values())) > 1 or len(next(iter(shapes.values()))) != 1:
        raise InputError(f"columns: expected one axis of samples, of one length for all; got shapes {shapes}")
    rows = len(next(iter(arrays.values())))
    if rows < 2:
        raise InputError(f"columns: expected at least two samples; got {rows}")
    if not 0 < _number(step) < math.inf:
        raise InputError(f"step: expected the time between two samples, above zero [s]; got {step!r}")
    for key, level in (noise or {}).items():
        if not 0 < _number(level) < math.inf:
            raise InputError(f"noise[{key!r}]: expected a standard deviation above zero (SI); got {level!r}")
    if horizon is not None and not step <= _number(horizon) <= rows * step:
        raise InputError(
            f"horizon: expected a time from one step, {step:g} s, to the whole recording, {rows * step:g} s; "
            f"got {horizon!r}"
        )
    if not isinstance(breaks, Sequence | np.ndarray) or isinstance(breaks, str):
        raise InputError(f"breaks: expected a list of rows; got {breaks!r}")
    if wrong := [row for row in breaks if not 0 < _number(row) < rows or int(row) != row]:
        raise InputError(f"breaks: expected rows between 1 and {rows - 1}; got {wrong}")
    card = _unsure_of(_card(actuator, needs, dict(noise or {}), horizon), uncertain or {})
    if all(np.isfinite(values).any() for values in arrays.values()):
        check_machine(f"recording {name!r}", rig, card, arrays, float(step))
    clock = float(step) * np.arange(rows, dtype=np.float64)
    ordered = tuple(sorted({int(row) for row in breaks}))
    whole = Recording(name, None, None, card, clock, float(step), arrays, ordered)
    taken = _rows_taken(whole, rig, request_of(stretch, every))
    if horizon is not None and not taken.step <= horizon <= len(taken) * taken.step:
        raise InputError(
            f"horizon: expected a time from one step, {taken.step:g} s, to all that is taken, "
            f"{len(taken) * taken.step:g} s; got {horizon:g}. {taken.left_out}"
        )
    return taken


def _rows_taken(whole: Recording, rig: type[AbstractActuator], asked: RowRequest) -> Recording:
    part = stretch_of(whole.time, asked, repr(whole.name))
    cut = whole.part(part.start, part.stop)
    found = selected(
        repr(whole.name), cut.time, cut.columns, asked, held=rig.commands, largest_step=rig.largest_step,
        breaks=cut.breaks, total=len(whole),
    )  # fmt: skip
    if found.unasked:
        warnings.warn(found.told, LongRecording, stacklevel=3)
    if not found.told:
        return whole
    step = float(found.time[-1] - found.time[0]) / max(len(found.time) - 1, 1)
    return dataclasses.replace(
        cut, time=found.time, step=step, columns=found.columns, breaks=found.breaks, left_out=found.told
    )


def _number(given: object) -> float:
    """A number, NaN for what is none: that passes no check."""
    if isinstance(given, bool | str):
        return math.nan
    try:
        return float(given)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _samples(given: object, name: str) -> Series:
    try:
        return np.asarray(given, dtype=float)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"columns[{name!r}]: expected an array of numbers; {error}") from error


def _unsure_of(card: Card, uncertain: Mapping[str, float]) -> Card:
    """The card with standard deviations of some of its known quantities.

    The rig need not be registered, which :meth:`Card.updated` asks for.
    """
    for key, std in uncertain.items():
        if key not in card.known:
            raise InputError(f"uncertain: unknown quantity {key!r}{nearest(str(key), card.known)}")
        if not 0 < _number(std) < math.inf:
            raise InputError(
                f"uncertain[{key!r}]: expected a standard deviation above zero (SI); got {std!r}"
            )
    unsure = {key: dataclasses.replace(card.known[key], std=float(std)) for key, std in uncertain.items()}
    known = {key: quantity for key, quantity in card.known.items() if key not in unsure}
    return dataclasses.replace(card, known=known, uncertain=unsure)


def _card(
    actuator: AbstractActuator, needs: Mapping[str, Need], noise: dict[str, float], horizon: float | None
) -> Card:
    """The card of a machine whose every quantity is known."""
    columns = {
        key: ColumnSpec(key, need.unit, "absolute" if need.referenced else None)
        for key, need in {schema.CLOCK.name: Need(schema.CLOCK.unit, "clock"), **needs}.items()
    }
    known = {}
    for key, need in schema.quantities(type(actuator)).items():
        value = float(get(actuator, actuator.quantities[key]))
        known[key] = Quantity(value, None, need.unit, "absolute" if need.referenced else None)
    return Card(actuator.rig, columns, known, {}, noise=noise, horizon=horizon)
