"""Survey of a card and its table: everything that is wrong at once, and how they were understood."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.files import existing_file, file_content
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.clocks import holds_stamps, stamps_to_seconds
from jaxmuscle.recordings.read import checks, rows_asked, rows_taken, table_in_file
from jaxmuscle.recordings.readers import READERS, SUFFIXES, is_of_dataset, table_ending, table_name
from jaxmuscle.recordings.row_selection import RowRequest
from jaxmuscle.recordings.table import Table
from jaxmuscle.recordings.table_checks import JITTER
from jaxmuscle.units import Series

NOT_ASKED = RowRequest()


@dataclasses.dataclass(frozen=True)
class ColumnRange:
    """A column of a table in the unit in which it stands there.

    Attributes:
        column: its name.
        quantity: what the card takes it for; `None` of one that is not used.
        unit, reference: as the card has them.
        low, high: its range; `None` where it holds something else than numbers.
        empty: entries without a number.
    """

    column: str
    quantity: str | None
    unit: str | None
    reference: str | None
    low: float | None
    high: float | None
    empty: int


@dataclasses.dataclass(frozen=True)
class Sampling:
    """The clock of a table: number of samples, length and median step [s], how many steps deviate from it by
    more than 1 %, the longest step [s].
    """

    samples: int
    length: float
    step: float
    irregular: int
    longest: float


@dataclasses.dataclass(frozen=True)
class Survey:
    """What is wrong with a card and its table, and what was understood of them.

    Attributes:
        card, table: as far as they could be read.
        faults: a message for each file or check that refused.
        ranges: of every column, those of the card first.
        sampling: of the card's clock, if it was found.
        gaps: quantity → samples on that clock at which a sensor with a clock of its own shows nothing.
        left_out: which rows are taken and why, a sentence, when they are not all.
    """

    card: Card | None
    table: Table | None
    faults: tuple[str, ...]
    ranges: tuple[ColumnRange, ...]
    sampling: Sampling | None
    gaps: Mapping[str, int]
    left_out: str = ""


def survey(
    card_file: Path, table_file: Path | None = None, *, resample: bool = False, asked: RowRequest = NOT_ASKED
) -> Survey:
    """Read a card and its table and hold them to every check that can still be made.

    Args:
        card_file: the card.
        table_file: its table; that of the same name in the same folder when not given.
        resample: whether an irregular clock is to be made uniform.
        asked: which of the rows are to be taken.
    """
    faults: list[str] = []
    card = table = None
    try:
        card = Card.read(card_file)
    except InputError as error:
        faults.append(str(error))
    try:
        table, _ = table_in_file(table_beside(card_file) if table_file is None else table_file)
    except InputError as error:
        faults.append(str(error))
    specs = _specs(card, card_file)
    sampling, gaps, left_out = None, {}, ""
    if table is not None and card is None:
        faults += _absent(table, specs)
    if table is not None and card is not None:
        sampling, gaps, left_out, found = _checked(table, card, resample, asked)
        faults += found
    ranges = () if table is None else _ranges(table, specs)
    # A card that is not there is missed when its table is sought, too.
    return Survey(card, table, tuple(dict.fromkeys(faults)), ranges, sampling, gaps, left_out)


def table_beside(card_file: Path) -> Path:
    """The one table of a card's name in its folder; `InputError` when there is none, or several."""
    existing_file(card_file, "card", (".toml",))
    there = sorted(
        file
        for file in card_file.parent.iterdir()
        if table_ending(file) in READERS and table_name(file) == card_file.stem and file.is_file()
    )
    if is_of_dataset(without := card_file.with_suffix("")):
        there.append(without)
    if len(there) == 1:
        return there[0]
    found = "there are several" if there else f"there is none that ends with {', '.join(SUFFIXES)}"
    listed = f": {', '.join(file.name for file in there)}" if there else ""
    raise InputError(
        f"{card_file}: expected its table {card_file.stem} beside it; {found}{listed}. Name it: --recording"
    )


def sampling_of(time: Series) -> Sampling | None:
    """The sampling of a clock [s]; `None` of one with less than two samples."""
    if len(time) < 2:
        return None
    steps = np.diff(time)
    step = float(np.median(steps))
    irregular = int((np.abs(steps - step) > JITTER * abs(step)).sum())
    return Sampling(len(time), float(time[-1] - time[0]), step, irregular, float(steps.max()))


def _checked(
    table: Table, card: Card, resample: bool, asked: RowRequest
) -> tuple[Sampling | None, dict[str, int], str, list[str]]:
    """Sampling, gaps, what is left out and the messages of all checks; without a clock that increases only
    the first ones.
    """
    faults: list[str] = []
    try:
        table, columns, rows = rows_asked(table, card, asked)
    except InputError as error:
        return None, {}, "", [str(error)]
    time = columns.pop("time")
    first, *rest = checks(table, card, time, columns, resample, asked)
    for check in (first, *rest):
        try:
            check()
        except InputError as error:
            faults.append(str(error))
            if check is first:
                break
    missing = {name: int(np.isnan(values).sum()) for name, values in columns.items()}
    gaps = {name: count for name, count in missing.items() if count}
    left_out = ""
    if not faults:
        try:
            left_out = rows_taken(table, card, time, columns, asked, rows)[0].told
        except InputError as error:
            faults.append(str(error))
    return sampling_of(time), gaps, left_out, faults


def _specs(card: Card | None, card_file: Path) -> dict[str, Mapping[str, Any]]:
    """The columns that a card names, also one that is wrong elsewhere."""
    if card is not None:
        return {name: dataclasses.asdict(spec) for name, spec in card.columns.items()}
    try:
        columns = tomllib.loads(file_content(card_file).decode("utf-8-sig")).get("columns", {})
    except (InputError, ValueError):
        return {}
    entries = columns.items() if isinstance(columns, Mapping) else ()
    return {n: e for n, e in entries if isinstance(e, Mapping) and isinstance(e.get("column"), str)}


def _absent(table: Table, specs: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [
        f"{table.file}: column {spec['column']!r} ({name}): {table.absence(spec['column'])}"
        for name, spec in specs.items()
        if spec["column"] not in table.columns and spec["column"] != "?"
    ]


def _ranges(table: Table, specs: Mapping[str, Mapping[str, Any]]) -> tuple[ColumnRange, ...]:
    used = {spec["column"]: name for name, spec in specs.items() if spec["column"] in table.columns}
    names = [*used, *(name for name in table.columns if name not in used)]
    return tuple(_range(table, name, used.get(name), specs.get(used.get(name, ""), {})) for name in names)


def _range(table: Table, column: str, quantity: str | None, spec: Mapping[str, Any]) -> ColumnRange:
    unit, reference = spec.get("unit"), spec.get("reference")
    bare = (column, quantity, unit, reference)
    try:
        entries = table.entries(column)
        if holds_stamps(entries):
            values = stamps_to_seconds(table, column)
        else:
            values = np.asarray(table.numbers_or_nan(column))
    except InputError:
        return ColumnRange(*bare, None, None, 0)
    there = values[np.isfinite(values)]
    if there.size == 0:
        return ColumnRange(*bare, None, None, len(values))
    return ColumnRange(*bare, float(there.min()), float(there.max()), len(values) - there.size)
