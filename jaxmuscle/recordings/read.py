"""Reading of a recording from its files."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.errors import InputError, Problems
from jaxmuscle.files import existing_file, file_content
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.plausibility import check_machine
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.table import SUFFIXES, Table, read_table, resampled
from jaxmuscle.recordings.table_checks import (
    check_clock,
    check_horizon,
    check_regular,
    check_signals,
    is_regular,
)
from jaxmuscle.units import Series, to_si


def read(path: str | Path, card: Card | str | Path | None = None, *, resample: bool = False) -> Recording:
    """The recording in a table and its card, in SI and checked. Writes nothing.

    Args:
        path: a table, ``.csv`` or ``.mat``; :func:`jaxmuscle.recordings.table.read_table` says how
            they are laid out.
        card: the card or its file; the ``.toml`` of the same stem when not given.
        resample: bring an irregular clock to a uniform one with the median step; see
            :func:`jaxmuscle.recordings.table.resampled`. A regular clock is left as it is.

    Raises:
        InputError: table or card are not what they should be; the message says where and what to do.
    """
    file = Path(path)
    if file.suffix.lower() not in SUFFIXES:
        got = f"got {file.suffix!r}" if file.suffix else "got none"
        raise InputError(f"{file}: expected a table with the ending {' or '.join(SUFFIXES)}; {got}")
    existing_file(file, "recording", SUFFIXES)
    content = file_content(file)
    table = read_table(file, content)
    if not isinstance(card, Card):
        card = Card.read(_card_beside(file) if card is None else card)
    return _recording(table, card, hashlib.sha256(content).hexdigest(), resample)


def _card_beside(file: Path) -> Path:
    try:
        return existing_file(file.with_suffix(".toml"), "card", (".toml",))
    except InputError as error:
        raise InputError(
            f"{file} has no card beside it: {error}; write one, or name it with card=, --card"
        ) from error


def _recording(table: Table, card: Card, sha256: str, resample: bool) -> Recording:
    columns = _si_columns(table, card)
    time = columns.pop("time")
    check_clock(table, card, time)
    check_regular(table, card, time, resample=resample)
    check_signals(table, card, columns)
    typical = float(np.median(np.diff(time)))
    check_machine(table.file, RIGS[card.rig], card, columns, typical, lambda index: f"row {table.row(index)}")
    check_horizon(table, card, time)
    if not is_regular(time):
        time, columns = resampled(time, columns, held=RIGS[card.rig].commands)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    return Recording(table.file.stem, table.file, sha256, card, time, step, columns)


def _si_columns(table: Table, card: Card) -> dict[str, Series]:
    needs = schema.columns(RIGS[card.rig])
    problems = Problems(table.file)
    columns: dict[str, Series] = {}
    for name, spec in card.columns.items():
        with problems.at(f"column {spec.column!r} ({name})"):
            shift = card.ambient_pressure if spec.reference == "gauge" else 0.0
            values = to_si(table.numbers(spec.column), spec.unit, needs[name].unit, needs[name].difference)
            columns[name] = values + shift
    problems.check()
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{table.file}: expected columns of one length; got {lengths}")
    return columns
