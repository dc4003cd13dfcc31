"""Tables of some of a card's quantities, in its units: commands or a reference in, readings out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmuscle.actuators import RIGS
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.clocks import resampled
from jaxmuscle.recordings.read import table_in_file
from jaxmuscle.recordings.schema import CLOCK
from jaxmuscle.recordings.si_columns import si_columns
from jaxmuscle.recordings.table_checks import check_clock, check_pressures, check_regular, is_regular
from jaxmuscle.units import Series, scale, to_si

FEWEST = 2
"""Rows that a table of commands or of a reference has at least."""


def read_signals(
    file: Path,
    card: Card,
    names: Sequence[str],
    *,
    resample: bool = False,
    regular: bool = True,
    kind: str = "table",
) -> tuple[Series, dict[str, Series]]:
    """The clock [s] and some quantities of a card, in SI, pressures absolute, from a table.

    Its columns are called as the card calls them, in the card's units; others are not looked at.

    Args:
        names: quantities of the card's rig.
        resample: bring an irregular clock to a uniform one with the median step.
        regular: whether the clock has to be uniform; where it need not be it stays as it is.
        kind: what the table is, in the words of a message.

    Raises:
        InputError: no such file, a column that is not there or holds no numbers, an irregular clock, a
            pressure that cannot be.
    """
    table, _ = table_in_file(file, kind)
    own = {name: card.columns[name] for name in (CLOCK.name, *names)}
    table, columns = si_columns(table, dataclasses.replace(card, columns=own))
    time = columns.pop(CLOCK.name)
    check_clock(table, card, time, FEWEST)
    if regular:
        check_regular(table, card, time, resample=resample)
    check_pressures(table, card, columns)
    if regular and not is_regular(time):
        time, columns = resampled(time, columns, held=RIGS[card.rig].commands)
    return time, columns


def signal_table(card: Card, signals: Mapping[str, Series]) -> pd.DataFrame:
    """Quantities in SI as a table that the card describes: its columns, its units, gauge where it says so.

    The inverse of :func:`read_signals`; the clock is among `signals`.
    """
    needs = schema.columns(RIGS[card.rig])
    found = {}
    for name, values in signals.items():
        spec, need = card.columns[name], needs[name]
        shift = card.ambient_pressure if spec.reference == "gauge" else 0.0
        zero = to_si(0.0, spec.unit, need.unit, need.difference) + shift
        found[spec.column] = (np.asarray(values, dtype=float) - zero) / scale(spec.unit, need.unit)
    return pd.DataFrame(found)


def check_commanded(card: Card) -> None:
    """Raise `InputError` for the card of a rig that a bench moves: there is nothing that a command does."""
    if not RIGS[card.rig].commands:
        raise InputError(f"rig {card.rig!r} has no command: its bench moves it")
