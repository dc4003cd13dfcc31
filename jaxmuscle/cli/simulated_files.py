"""Simulation from the command line: a card and a table of commands in, a table of readings and a picture out,
in the units of the card.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.cli.option_values import Unit, split_option, values_of
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.files import atomic_write, check_place
from jaxmuscle.progress import interruptible
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.recordings.signal_tables import check_commanded, read_signals, signal_table
from jaxmuscle.recordings.table import Table
from jaxmuscle.report.columns_figure import draw_columns
from jaxmuscle.simulation.simulate import Simulation, simulate
from jaxmuscle.units import Series

START = "NAME=VALUE[:UNIT[:gauge|absolute]]"
DIGITS = "%.10g"
"""Of numbers in a table: more than any sensor has."""


def simulated_files(
    card: Path,
    command: Path,
    out: Path,
    start: Sequence[str] = (),
    substeps: int | None = None,
    tolerance: float | None = None,
    plot: bool = False,
    resample: bool = False,
) -> list[Path]:
    """Simulate a card's machine under a table of commands and write what its sensors show.

    Returns:
        the files written: the table, which the card describes as it does a recording, and a picture of it.

    Raises:
        InputError: a card or a table that is not what it should be, a start that the machine has not, a
            machine that runs away; nothing is written.
    """
    _check_place(out)
    declared = Card.read(card)
    check_commanded(declared)
    rig = RIGS[declared.rig]
    time, commands = read_signals(
        command, declared, rig.commands, resample=resample, kind="table of commands"
    )
    given = np.stack([commands[name] for name in rig.commands], axis=-1)
    actuator, begin = actuator_from_card(declared), start_of(start, declared)
    found = interruptible(
        lambda: simulate(
            actuator,
            given if len(rig.commands) > 1 else given[:, 0],
            time,
            start=begin,
            substeps=substeps,
            tolerance=tolerance,
        ),
        stop=lambda: None,
    )
    check_finite(found)
    signals = {"time": time, **commands, **by_column(actuator, found.readings)}
    return _written(signal_table(declared, signals), declared, out, plot)


def by_column(actuator: AbstractActuator, readings: Mapping[str, object]) -> dict[str, Series]:
    """Column of a recording → its samples, from the readings of a run."""
    found = {}
    for name, columns in actuator.outputs.items():
        values = np.asarray(readings[name], dtype=float)
        table = values.reshape(len(values), -1)
        found.update({column: table[:, i] for i, column in enumerate(columns)})
    return found


def start_of(settings: Sequence[str], card: Card) -> dict[str, float]:
    """States at the first sample by ``--start``: columns of the card in its units, other states in SI.

    Raises:
        InputError: another form, no such column or state, a unit of another kind.
    """
    rig, found = RIGS[card.rig], {}
    needs = schema.columns(rig)
    places = {
        column: f"{state}[{i}]" if len(columns) > 1 else state
        for state, columns in rig.measured.items()
        for i, column in enumerate(columns)
    }
    others = {name: each.unit for name, each in rig.states.items() if name not in rig.measured}
    for text in settings:
        name, body = split_option(text, "--start", START)
        if name in places:
            spec, need = card.columns[name], needs[name]
            ambient = card.ambient_pressure if need.referenced else 0.0
            unit = Unit(spec.unit, need.unit, ambient if spec.reference == "gauge" else 0.0, ambient)
        elif name in others:
            unit = Unit(others[name], others[name])
        else:
            raise InputError(f"--start: unknown state {name!r}{nearest(name, [*places, *others])}")
        values = values_of(body, f"--start {text}", START, unit)
        if len(values) != 1:
            raise InputError(f"--start {text}: expected {START}, one value; got {len(values)}")
        found[places.get(name, name)] = float(values[0])
    return found


def check_finite(found: Simulation) -> None:
    """Raise `InputError` for a run whose readings are not finite."""
    for name, values in found.readings.items():
        wrong = ~np.isfinite(np.asarray(values).reshape(len(found.time), -1)).all(axis=1)
        if wrong.any():
            at = float(found.time[int(np.argmax(wrong))])
            raise InputError(
                f"the machine ran away: its {name} is no number from {at:.6g} s on. Look at the commands and "
                f"the card, or take more steps between samples: --substeps"
            )


def _check_place(out: Path) -> None:
    """Better now than after the work."""
    if out.suffix != ".csv":
        raise InputError(f"--output {out}: expected a name that ends in .csv")
    check_place(out, "--output")


def _written(table: pd.DataFrame, card: Card, out: Path, plot: bool) -> list[Path]:
    """The table and its picture, both or none."""
    files = [out, *([out.with_suffix(".png")] if plot else [])]
    with atomic_write(*files) as (text, *pictures):
        table.to_csv(text, index=False, float_format=DIGITS, lineterminator="\n")
        for picture in pictures:
            shown = {name: spec for name, spec in card.columns.items() if spec.column in table.columns}
            columns = {str(name): table[name].to_numpy() for name in table.columns}
            draw_columns(Table(out, columns, 1), shown, picture)
    return files
