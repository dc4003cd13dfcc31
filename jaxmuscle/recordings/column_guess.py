"""Guessing which column of a table is which quantity of a rig, in which unit, gauge or absolute.

Names count first, then units, then magnitudes; what rests on magnitudes alone is marked as unsure.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.clocks import holds_stamps, stamps_to_seconds
from jaxmuscle.recordings.column_names import ColumnName, column_name
from jaxmuscle.recordings.schema import CLOCK, Need, Rig
from jaxmuscle.recordings.table import Table
from jaxmuscle.units import CANDIDATES, STANDARD_ATMOSPHERE, Series, is_same_unit, scale

COMMANDED = frozenset(
    "cmd command commands commanded set setpoint setpt sp ref reference target desired des soll sollwert u "
    "dac ao out output input control ctrl action pd pset pcmd pref pdes psoll".split()
)
"""Words of what a computer commands."""
WORDS: dict[str, frozenset[str]] = {
    "time": frozenset("t time times zeit timestamp timestamps stamp clock sec seconds".split()),
    "pressure": frozenset("p pressure pressures press pres druck muscle pm".split()),
    "supply_pressure": frozenset("supply ps source versorgung line".split()),
    "position": frozenset(
        "x y z s position pos displacement disp contraction stroke weg travel lift height laser".split()
    ),
    "force": frozenset("f force kraft load loadcell tension pull".split()),
    "angle": frozenset("theta θ phi φ q angle winkel alpha joint rotation encoder".split()),
    "current": frozenset("i current strom amp coil".split()),
    "command": COMMANDED | frozenset("valve voltage volt ventil spannung v".split()),
}
"""Quantity without its number → words in the names of its columns."""
USUAL: dict[str, tuple[float, float]] = {
    "Pa": (1e5, 1.2e6),
    "m": (2e-3, 0.5),
    "rad": (0.02, 6.3),
    "N": (2, 2e4),
    "V": (0.2, 30),
    "A": (1e-3, 20),
    "K": (250, 400),
}
"""SI unit → sizes of the largest sample of a signal of a bench."""
LESS_USUAL = 10.0
"""By what ratio a signal may be outside of these sizes for a unit to be named beside the likeliest."""
STEP = (2e-4, 0.05)
"""Usual sampling steps [s]."""
VENTED = 0.97
"""Share of the atmosphere below which a pressure has to be gauge: nothing draws a muscle empty."""
MOST = 0.5
"""Share of entries that are numbers in a column of them."""
NEEDED, CLEAR = 3.0, 1.0
"""Score that a column needs to be taken, and how far ahead of the next one it is clear."""


@dataclasses.dataclass(frozen=True)
class Guess:
    """A column that is taken for a quantity.

    Attributes:
        column, unit, reference: as a card has them; `None` of what nothing tells.
        said: why, and what is unsure, a line each.
        sure: whether names and units tell all of it.
    """

    column: str | None
    unit: str | None
    reference: str | None
    said: tuple[str, ...]
    sure: bool


@dataclasses.dataclass(frozen=True)
class Signal:
    """A column of a table that may be a signal.

    `values` are those of its entries that are numbers; `times`: whether the file has it as a clock of others.
    """

    column: str
    name: ColumnName
    values: Series
    stamps: bool
    increasing: bool
    times: bool


def signals_of(table: Table) -> list[Signal]:
    """The columns of numbers, a few of which may be missing, and those of time stamps."""
    found, clocks = [], {*table.clocks.values()}
    for column in table.columns:
        name = column_name(column, table.units.get(column, ""))
        try:
            stamps = holds_stamps(table.entries(column))
            values = stamps_to_seconds(table, column) if stamps else table.numbers_or_nan(column)
        except InputError:
            continue
        there = values[np.isfinite(values)]
        increasing = len(values) > 1 and bool(np.all(np.diff(values) > 0))
        if len(there) > MOST * len(values):
            found.append(Signal(column, name, there, stamps, increasing, column in clocks))
    return found


def guess_columns(table: Table, rig: Rig) -> dict[str, Guess]:
    """Quantity of the rig → the column that is most likely it; see :class:`Guess`."""
    needs = schema.columns(rig)
    signals = _counted_from_one(signals_of(table), needs)
    scores = np.array([[_score(rig, name, need, s) for s in signals] for name, need in needs.items()])
    if not signals:
        return {name: Guess(None, None, None, ("no column of numbers",), False) for name in needs}
    # Of columns that are as likely, the first is that of the first quantity.
    order = np.subtract.outer(np.arange(len(needs)) / len(needs), np.arange(len(signals)) / len(signals))
    rows, taken = linear_sum_assignment(scores - 0.01 * np.abs(order), maximize=True)
    chosen = {
        list(needs)[row]: signals[i] for row, i in zip(rows, taken, strict=True) if scores[row, i] >= NEEDED
    }
    found = {}
    for row, (name, need) in enumerate(needs.items()):
        if name not in chosen:
            found[name] = Guess(None, None, None, ("no column looks like it",), False)
            continue
        free = [i for i, s in enumerate(signals) if s not in chosen.values()]
        mine = scores[row, signals.index(chosen[name])]
        rivals = [signals[i].column for i in free if scores[row, i] >= max(NEEDED, mine - CLEAR)]
        found[name] = _guess(name, need, chosen[name], rivals)
    return _with_references(found, chosen, needs)


def guess_rig(table: Table, rigs: Mapping[str, Rig]) -> list[str]:
    """The rigs whose every column is found in the table, those that use most of its columns first."""
    fitting = {}
    for name, rig in rigs.items():
        guesses = guess_columns(table, rig)
        if all(guess.column is not None for guess in guesses.values()):
            fitting[name] = len(guesses)
    return sorted(fitting, key=lambda name: -fitting[name])


def _score(rig: Rig, name: str, need: Need, signal: Signal) -> float:
    """How well a column goes with a quantity; below zero where it cannot be it."""
    if name == CLOCK.name:
        return _score_of_clock(signal)
    said = signal.name
    if signal.stamps or (said.unit is not None and not is_same_unit(said.unit, need.unit)):
        return -10.0
    base, number = _base(name)
    words = {*said.words}
    commanded = name in rig.commands
    score = 3.0 if said.unit is not None else 0.0
    score += 3.0 if words & WORDS.get(base, frozenset({base})) else 0.0
    score += 1.0 if base in words else 0.0
    if commanded != bool(words & COMMANDED):
        score -= 2.5 if not (commanded and words & WORDS["command"]) else 0.0
    if number is not None and said.number is not None:
        score += 2.0 if number == said.number else -2.0
    if base != "supply_pressure" and words & WORDS["supply_pressure"] and need.unit == "Pa":
        score -= 3.0
    return score - (2.0 if len(signal.values) and np.ptp(signal.values) == 0 else 0.0)


def _score_of_clock(signal: Signal) -> float:
    if not signal.increasing:
        return -10.0
    said = signal.name
    if said.unit is not None and not is_same_unit(said.unit, "s"):
        return -10.0
    likely = 3.0 if {*said.words} & WORDS["time"] else 0.0
    # Of a bag, "logged" is when messages were written; the file itself says which clock holds.
    held = 1.5 * signal.times
    return 3.0 + likely + held + (2.0 if signal.stamps or said.unit is not None else 0.0)


def _counted_from_one(signals: list[Signal], needs: Mapping[str, Need]) -> list[Signal]:
    """Signals with numbers as the rig counts, where those of the table begin with 0."""
    wanted = {number for name in needs if (number := _base(name)[1]) is not None}
    given = {signal.name.number for signal in signals}
    if not wanted or 0 not in given or max(wanted) in given:
        return signals
    numbers = [None if s.name.number is None else s.name.number + 1 for s in signals]
    names = [dataclasses.replace(s.name, number=n) for s, n in zip(signals, numbers, strict=True)]
    return [dataclasses.replace(s, name=name) for s, name in zip(signals, names, strict=True)]


def _base(name: str) -> tuple[str, int | None]:
    """``pressure_2`` → pressure, 2."""
    found = re.fullmatch(r"(.*?)_?(\d+)", name)
    return (found[1], int(found[2])) if found else (name, None)


def _guess(name: str, need: Need, signal: Signal, rivals: Sequence[str]) -> Guess:
    said, sure = [], True
    if rivals:
        said.append(f"or is it {' or '.join(map(repr, rivals[:3]))}?")
        sure = False
    words = WORDS.get(_base(name)[0], frozenset({_base(name)[0]}))
    if not words & {*signal.name.words}:
        said.append(
            "told by its unit and place only" if signal.name.unit else "the only column that increases"
        )
        sure = False
    number = _base(name)[1]
    if number is not None and signal.name.number is None:
        said.append(f"taken as number {number} by its place among the columns")
        sure = False
    unit = "s" if signal.stamps else signal.name.unit
    if unit is None:
        unit, others = _units_by_size(name, need, signal.values)
        low, high = (float(f(signal.values)) for f in (np.min, np.max))
        beside = f"; or {' or '.join(others)}" if others else ""
        said.append(f"unit by its size, {low:.4g} to {high:.4g}{beside}")
        sure = False
    return Guess(signal.column, unit, signal.name.reference, tuple(said), sure)


def _units_by_size(name: str, need: Need, values: Series) -> tuple[str | None, list[str]]:
    """The likeliest unit of a column that says none, and others that may be."""
    if need.unit == "":
        return "", []
    size = float(np.median(np.diff(values))) if name == CLOCK.name else float(np.max(np.abs(values)))
    low, high = STEP if name == CLOCK.name else USUAL.get(need.unit, (0.0, np.inf))
    units = CANDIDATES.get(need.unit, (need.unit,))
    if need.unit == "rad":
        units = ("rad", "deg") if size <= 2 * np.pi else ("deg",)
    sizes = {unit: size * scale(unit, need.unit) for unit in units}
    usual = [unit for unit in units if low <= sizes[unit] <= high]
    possible = [unit for unit in units if low / LESS_USUAL <= sizes[unit] <= high * LESS_USUAL]
    if name == CLOCK.name and usual:
        possible = usual  # Sampling steps are alike, other than the sizes of signals.
    likeliest = next(iter([*usual, *possible]), None)
    return likeliest, [unit for unit in possible if unit != likeliest]


def _with_references(
    guesses: dict[str, Guess], signals: Mapping[str, Signal], needs: Mapping[str, Need]
) -> dict[str, Guess]:
    """Guesses with gauge or absolute for all pressures: by names, else by the lowest of all of them."""
    silent = [
        name
        for name, guess in guesses.items()
        if needs[name].referenced and guess.column and guess.unit and guess.reference is None
    ]
    if not silent:
        return guesses
    lowest = min(float(signals[n].values.min()) * scale(guesses[n].unit or "Pa", "Pa") for n in silent)
    low = f"{lowest / 1e5:.3g} bar"
    if lowest < VENTED * STANDARD_ATMOSPHERE:
        reference, why, sure = "gauge", f"gauge: pressures fall to {low}, below the atmosphere's", True
    elif lowest < STANDARD_ATMOSPHERE / VENTED:
        reference, why, sure = "absolute", f"absolute by its lowest, {low}, about the atmosphere's", False
    else:
        reference, why, sure = "gauge", f"gauge is more common; the lowest, {low}, does not tell", False
    return {
        name: dataclasses.replace(
            guess, reference=reference, said=(*guess.said, why), sure=guess.sure and sure
        )
        if name in silent
        else guess
        for name, guess in guesses.items()
    }
