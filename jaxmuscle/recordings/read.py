"""Reading of a recording from its files."""

from __future__ import annotations

import dataclasses
import hashlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from jaxmuscle.actuators import RIGS
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import InputError
from jaxmuscle.files import existing_file, file_content
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_rows import NamedRows, named_rows
from jaxmuscle.recordings.clocks import resampled
from jaxmuscle.recordings.plausibility import check_machine
from jaxmuscle.recordings.readers import SUFFIXES, file_of, read_table, table_name
from jaxmuscle.recordings.readers.frames import table_in_memory
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.row_selection import (
    LongRecording,
    RowRequest,
    Selected,
    request_of,
    selected,
    stretch_of,
)
from jaxmuscle.recordings.si_columns import si_columns
from jaxmuscle.recordings.table import Table
from jaxmuscle.recordings.table_checks import (
    check_clock,
    check_horizon,
    check_regular,
    check_signals,
    is_regular,
)
from jaxmuscle.units import Series


def read(
    path: str | Path | pd.DataFrame | xr.Dataset,
    card: Card | str | Path | None = None,
    *,
    resample: bool = False,
    stretch: str | Sequence[float] | None = None,
    every: int | None = None,
) -> Recording:
    """The recording in a table and its card, in SI and checked. Writes nothing.

    Args:
        path: a table: ``.csv`` and other delimited texts, ``.mat``, ``.npz``, ``.npy``; ``.parquet``,
            ``.xlsx``, ``.h5``, ``.tdms``, ``.mf4``, ``.mcap``, ``.db3`` and ``.bag`` where their libraries
            are installed (``jaxmuscle[files]``), and with pyarrow ``DATASET/episode_000003`` of a LeRobot
            dataset. :mod:`jaxmuscle.recordings.readers` has a module for each
            that says how they are laid out. Or a pandas DataFrame or an xarray Dataset in the units that the
            card names.
        card: the card or its file; the ``.toml`` of the same stem when not given.
        resample: bring an irregular clock to a uniform one with the median step; see
            :func:`jaxmuscle.recordings.clocks.resampled`. A regular clock is left as it is.
        stretch: what to take, in seconds of the table's clock: ``(100, 200)`` or ``"100:200"``; or ``"all"``.
            When not given, all of a table of up to :data:`~jaxmuscle.recordings.row_selection.MOST_ROWS`
            rows; of a longer one what :func:`~jaxmuscle.recordings.row_selection.selected` says, which a
            warning and the recording's `left_out` tell.
        every: take one of so many samples.

    Signals of groups or topics with clocks of their own are brought to the one that the card names:
    :func:`jaxmuscle.recordings.clocks.on_clock`. What is measured is then NaN in gaps, where it counts for
    nothing.

    Raises:
        InputError: table or card are not what they should be; the message says where and what to do.
    """
    asked = request_of(stretch, every)
    if not isinstance(path, str | Path):
        table = table_in_memory(path)
        if card is None:
            raise InputError(f"{table.file}: expected its card as card=, since no file lies beside it")
        given = card if isinstance(card, Card) else Card.read(card)
        return _recording(table, given, None, resample, asked)
    table, sha256 = table_in_file(Path(path))
    if not isinstance(card, Card):
        card = Card.read(_card_beside(Path(path)) if card is None else card)
    return _recording(table, card, sha256, resample, asked)


def table_in_file(file: Path, kind: str = "recording") -> tuple[Table, str]:
    """The table in a file, and the checksum of the file that holds it; errors as of :func:`read`.

    `kind`: what it is, in the words of a message.
    """
    content = file_content(existing_file(file_of(file), kind, SUFFIXES))
    return read_table(file, content), hashlib.sha256(content).hexdigest()


def _card_beside(file: Path) -> Path:
    try:
        return existing_file(file.with_name(f"{table_name(file)}.toml"), "card", (".toml",))
    except InputError as error:
        raise InputError(
            f"{file} has no card beside it: {error}; name it with card=, --card, or have one drafted: "
            f"jaxmuscle init {file}"
        ) from error


def _recording(table: Table, card: Card, sha256: str | None, resample: bool, asked: RowRequest) -> Recording:
    table, columns, rows = rows_asked(table, card, asked)
    time = columns.pop("time")
    for check in checks(table, card, time, columns, resample, asked):
        check()
    taken, named = rows_taken(table, card, time, columns, asked, rows)
    if taken.unasked:
        warnings.warn(taken.told, LongRecording, stacklevel=3)
    file = table.file if isinstance(table.file, Path) else None
    held_out = None if named.held_out is None else named.held_out[taken.rows]
    return Recording(
        str(table.file) if file is None else table_name(file),
        file,
        sha256,
        card,
        taken.time,
        float(taken.time[-1] - taken.time[0]) / (len(taken.time) - 1),
        taken.columns,
        taken.breaks,
        {column: bad[taken.rows] for column, bad in named.ignored.items()},
        held_out if held_out is not None and held_out.any() else None,
        left_out=taken.told,
    )


def rows_taken(
    table: Table, card: Card, time: Series, columns: Mapping[str, Series], asked: RowRequest, total: int
) -> tuple[Selected, NamedRows]:
    """What is taken of the rows that :func:`rows_asked` gives, on a uniform clock, and which the card names.

    Args:
        table, card, asked: as of :func:`rows_asked`.
        time, columns: what it gave, after :func:`checks`.
        total: rows of the whole table.

    Raises:
        InputError: as of :func:`~jaxmuscle.recordings.card_rows.named_rows`; a horizon that is longer than
            what is taken, or so many samples passed over that too few are left.
    """
    rig, read = RIGS[card.rig], len(time)
    if not is_regular(time):
        time, columns = resampled(time, columns, held=rig.commands)
    named = _rows_of_card(table, card, time, asked)
    taken = selected(
        table.file.name if isinstance(table.file, Path) else table.file,
        time,
        columns,
        asked,
        held=rig.commands,
        largest_step=rig.largest_step,
        breaks=named.breaks,
        ignored=named.ignored,
        held_out=named.held_out,
        total=total + len(time) - read,
    )
    if taken.told:
        check_horizon(table, card, taken.time)
    return taken, named


def rows_asked(table: Table, card: Card, asked: RowRequest) -> tuple[Table, dict[str, Series], int]:
    """The stretch that is asked for, as of :func:`si_columns`, and the number of all rows.

    Raises:
        InputError: what is wrong with the columns; no row lies in the stretch, or in what the card names.
    """
    table, columns = si_columns(table, card)
    rows = len(columns["time"])
    if asked.stretch is None:
        return table, columns, rows
    # A span that lies nowhere in the table is a slip of the pen; one outside of the stretch is none.
    clock = columns["time"][np.isfinite(columns["time"])]
    named_rows(card.row_spans, clock, measured_columns(RIGS[card.rig]), str(table.file))
    part = stretch_of(columns["time"], asked, table.file)
    if table.rows is None:
        table = dataclasses.replace(table, first_row=table.first_row + part.start)
    else:
        table = dataclasses.replace(table, rows=table.rows[part])
    return table, {name: values[part] for name, values in columns.items()}, rows


def checks(
    table: Table,
    card: Card,
    time: Series,
    columns: Mapping[str, Series],
    resample: bool,
    asked: RowRequest,
) -> list[Callable[[], object]]:
    """What a table has to pass beside its card, each raising `InputError`; the first before all others.

    Args:
        table: for file and rows.
        card: how it was made.
        time: the clock [s].
        columns: quantity → samples in SI, pressures absolute.
        resample: whether an irregular clock may be made uniform.
        asked: which rows of the table were asked for; these are they.
    """
    rig = RIGS[card.rig]
    return [
        lambda: check_clock(table, card, time),
        lambda: check_regular(table, card, time, resample=resample),
        lambda: check_signals(table, card, columns),
        lambda: check_machine(
            table.file, rig, card, columns, float(np.median(np.diff(time))), lambda i: f"row {table.row(i)}"
        ),
        lambda: check_horizon(table, card, time),
        lambda: _rows_of_card(table, card, time, asked),
    ]


def _rows_of_card(table: Table, card: Card, time: Series, asked: RowRequest) -> NamedRows:
    """The rows that a card names; `InputError` where none lies there."""
    columns = measured_columns(RIGS[card.rig])
    return named_rows(card.row_spans, time, columns, str(table.file), stretch=asked.partial)
