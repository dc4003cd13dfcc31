"""Columns of a card from its table: in SI, pressures absolute, all on the clock that the card names."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.errors import InputError, Problems
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.clocks import holds_stamps, on_clock, stamps_to_seconds
from jaxmuscle.recordings.schema import CLOCK, ColumnSpec
from jaxmuscle.recordings.table import Table
from jaxmuscle.units import Series, is_same_unit, scale, to_si, unit_in


def si_columns(table: Table, card: Card) -> tuple[Table, dict[str, Series]]:
    """Quantity → samples, the clock among them [s], all of one length; and the table, to say which rows.

    Raises:
        InputError: everything that is wrong with the columns of the card.
    """
    problems = Problems(table.file)
    columns: dict[str, Series] = {}
    for name in card.columns:
        with problems.at(f"column {card.columns[name].column!r} ({name})"):
            columns[name] = _column(table, card, name)
    problems.check()
    if table.clocks:
        table, columns = _on_one_clock(table, card, columns)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{table.file}: expected columns of one length; got {lengths}")
    return table, columns


def _column(table: Table, card: Card, name: str) -> Series:
    need, spec = schema.columns(RIGS[card.rig])[name], card.columns[name]
    if name == CLOCK.name and spec.column in table.columns and holds_stamps(table.entries(spec.column)):
        if spec.unit != CLOCK.unit:
            raise InputError(
                f'holds time stamps, which are read as seconds since the first; expected unit = "s", got '
                f"unit = {spec.unit!r}"
            )
        return stamps_to_seconds(table, spec.column)
    _check_stated_unit(table, spec, need.unit)
    shift = card.ambient_pressure if spec.reference == "gauge" else 0.0
    return to_si(table.numbers(spec.column), spec.unit, need.unit, need.difference) + shift


def _check_stated_unit(table: Table, spec: ColumnSpec, si: str) -> None:
    """Raise `InputError` when the table itself gives the column another unit of the same kind."""
    stated = unit_in(table.units.get(spec.column, ""))
    if stated is None or not is_same_unit(stated[0], si):
        return
    if not np.isclose(scale(stated[0], si), scale(spec.unit, si), rtol=1e-6):
        raise InputError(
            f"the table gives its unit as {table.units[spec.column]!r}, the card as {spec.unit!r}; correct "
            f"the one that is wrong"
        )
    if stated[1] is not None and spec.reference not in (None, stated[1]):
        raise InputError(
            f"the table gives its unit as {table.units[spec.column]!r}, which is {stated[1]}; the card says "
            f"reference = {spec.reference!r}; correct the one that is wrong"
        )


def _on_one_clock(table: Table, card: Card, columns: dict[str, Series]) -> tuple[Table, dict[str, Series]]:
    """All columns at the instants of the card's clock, from the first to the last at which all commands are
    known and every sensor has begun and not yet ended.
    """
    clock, commands = card.columns[CLOCK.name].column, RIGS[card.rig].commands
    time, problems = columns[CLOCK.name], Problems(table.file)
    found = {CLOCK.name: time}
    for name in (name for name in columns if name != CLOCK.name):
        own = table.clocks.get(card.columns[name].column)
        if own is None or own == clock or own == table.clocks.get(clock, clock):
            found[name] = columns[name]
            continue
        with problems.at(f"column {card.columns[name].column!r} ({name})"):
            times = _increasing(table, own, card.columns[CLOCK.name])
            found[name] = on_clock(time, times, columns[name], held=name in commands)
    problems.check()
    if len({len(values) for values in found.values()}) > 1:
        return table, found
    there = np.all([np.isfinite(values) for values in found.values()], axis=0)
    if not there.any():
        spans = ", ".join(f"{card.columns[name].column!r}" for name in found)
        raise InputError(
            f"{table.file}: {spans} have no instant in common; were their clocks started together?"
        )
    first, last = np.flatnonzero(there)[[0, -1]]
    cut = {name: values[first : last + 1] for name, values in found.items()}
    return dataclasses.replace(table, first_row=table.first_row + int(first)), cut


def _increasing(table: Table, own: str, clock: ColumnSpec) -> Series:
    """The clock of a group [s], from the zero of the card's clock on.

    Raises:
        InputError: it does not increase, or it holds stamps where the card's clock holds numbers.
    """
    stamps = holds_stamps(table.entries(own))
    if stamps != holds_stamps(table.entries(clock.column)):
        kinds = ("time stamps", "numbers") if stamps else ("numbers", "time stamps")
        raise InputError(
            f"its clock {own!r} holds {kinds[0]} and {clock.column!r} {kinds[1]}; write both alike"
        )
    if stamps:
        seconds = stamps_to_seconds(table, own, zero=clock.column)
    else:
        stated = unit_in(table.units.get(own, ""))
        seconds = to_si(table.numbers(own), stated[0] if stated else clock.unit, CLOCK.unit)
    back = np.flatnonzero(np.diff(seconds) <= 0)
    if back.size:
        raise InputError(f"its clock {own!r} does not increase after sample {back[0] + 1}; mend or sort it")
    return seconds
