"""Draft of a card from a table: what could be told stands in it, the rest is marked to be filled in."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxmuscle.errors import InputError, Problems
from jaxmuscle.parameter_names import resolve, spelled
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.clocks import holds_stamps
from jaxmuscle.recordings.column_guess import Guess, guess_columns
from jaxmuscle.recordings.data_sheets import PARTS, sheet_quantities
from jaxmuscle.recordings.schema import (
    CLOCK,
    OPEN,
    ColumnSpec,
    Need,
    Quantity,
    Rig,
    read_column,
    read_quantity,
    written_quantity,
)
from jaxmuscle.recordings.table import Table
from jaxmuscle.recordings.toml_documents import entry_text
from jaxmuscle.recordings.typical import card_unit, default_in_card, meaning_in_card, rig_in_words, typical
from jaxmuscle.units import STANDARD_ATMOSPHERE, from_si, to_si

FILL_IN, CHECK = "FILL IN", "CHECK"
SETTING = (
    "NAME=VALUE[+-STD][:UNIT[:gauge|absolute]] or NAME=COLUMN[:UNIT[:gauge|absolute]] or muscle=TYPE or "
    "valve=TYPE"
)
NUMBER = re.compile(
    r"(?P<value>[+-]?[\d.]+(?:[eE][+-]?\d+)?)(?:\s*(?:\+-|±)\s*(?P<std>[\d.]+(?:[eE][+-]?\d+)?))?"
)
SIGNS = {
    "lift": ("shortening is positive, from the full length on",),
    "contraction": ("shortening is positive, from the full length on",),
    "muscle force": ("a pull is positive",),
}
"""What a column is held to → what nobody can tell from its name."""
WIDTH = 100
"""Column of the comments at most."""

Entry = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Draft:
    """A card that is begun.

    Attributes:
        rig: class of the machine.
        columns: quantity → guess of its column.
        entries: quantity → its entry, of those that have to stand in the card.
        hints: quantity → what the table tells of it.
        parts: muscle or valve → its type.
        taken: quantity → what the data sheets of the parts give, of those that `entries` has not.
    """

    rig: Rig
    columns: Mapping[str, Guess]
    entries: Mapping[str, Entry]
    hints: Mapping[str, str]
    parts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    taken: Mapping[str, Quantity] = dataclasses.field(default_factory=dict)

    @property
    def open(self) -> list[str]:
        """The quantities whose entries are still to be filled in."""
        columns = {name: _column_entry(self.rig, name, guess) for name, guess in self.columns.items()}
        return [name for name, entry in {**columns, **self.entries}.items() if OPEN in entry.values()]

    @property
    def specs(self) -> dict[str, ColumnSpec]:
        """The columns that were found, as a card has them."""
        return {
            name: ColumnSpec(guess.column, guess.unit or "", guess.reference)
            for name, guess in self.columns.items()
            if guess.column is not None
        }

    @property
    def unsure(self) -> list[str]:
        """The quantities whose columns are to be checked."""
        return [name for name, guess in self.columns.items() if guess.column and not guess.sure]

    def to_toml(self, table_name: str) -> str:
        """The card as TOML with comments; `table_name`: of the table beside it."""
        lines = [
            f"# Card of {table_name}, drafted by jaxmuscle init.",
            f"# {FILL_IN}: write what you know in place of {OPEN!r}. {CHECK}: guessed; see whether it is so.",
            "# Any unit will do; std is one standard deviation of what you know. Then: jaxmuscle check.",
            f"rig = {json.dumps(self.rig.rig)}  # {rig_in_words(self.rig)}",
            'description = ""',
            "",
            "[columns]  # quantity -> column of the table",
            *_aligned(self._column_lines()),
            *self._part_lines(),
        ]
        needs = schema.quantities(self.rig)
        fitted = [name for name, entry in self.entries.items() if "std" in entry]
        known = [name for name in self.entries if name not in fitted]
        if known:
            lines += ["", "[known]  # held fixed; with a std = … a quantity is fitted instead"]
            lines += _aligned([self._quantity_line(name, needs[name]) for name in known])
        left_out = [name for name in needs if name not in {**self.entries, **self.taken}]
        if left_out:
            lines += ["# Taken so unless you write otherwise:"] if known else ["", "[known]"]
            lines += _aligned([_default_line(self.rig, name, needs[name]) for name in left_out])
        if fitted:
            lines += ["", "[uncertain]  # fitted, from value ± std on"]
            lines += _aligned([self._quantity_line(name, needs[name]) for name in fitted])
        lines += [
            "",
            "# [noise]  # standard deviation of a sensor; estimated from the table where it is not given",
            *(
                f"# {name} = {entry_text({'value': OPEN, 'unit': guess.unit or OPEN})}"
                for name, guess in self._measured()
            ),
            "",
            "[fit]",
            'horizon = { value = 1, unit = "s" }  # predict in windows of this length',
        ]
        return "\n".join(lines) + "\n"

    def _part_lines(self) -> list[str]:
        """The sections of the parts, with what their data sheets give; or how to name a type."""
        needs, lines = schema.quantities(self.rig), []
        shown = {
            name: written_quantity(q, needs[name], STANDARD_ATMOSPHERE) for name, q in self.taken.items()
        }
        for part in PARTS:
            own = [n for n, path in self.rig.quantities.items() if path.startswith(f"{part}.")]
            given = [f"# {name} = {entry_text(shown[name])}" for name in own if name in shown]
            if part in self.parts:
                kind = json.dumps(self.parts[part], ensure_ascii=False)
                lines += [
                    "",
                    f"[{part}]  # its data sheet gives what does not stand below",
                    f"type = {kind}",
                    *given,
                ]
            elif own:
                lines += ["", f"# [{part}]  # a bought one: its data sheet gives what you leave out below"]
                lines += ['# type = "…"  # jaxmuscle init --types lists them']
        return lines

    def _measured(self) -> list[tuple[str, Guess]]:
        commands = ("time", *self.rig.commands)
        return [(name, guess) for name, guess in self.columns.items() if name not in commands]

    def _column_lines(self) -> list[tuple[str, str]]:
        lines = []
        for name, guess in self.columns.items():
            entry = _column_entry(self.rig, name, guess)
            mark = FILL_IN if OPEN in entry.values() else "" if guess.sure else CHECK
            check = None if name not in self.rig.columns else self.rig.column(name).check
            said = "; ".join([*guess.said, *SIGNS.get(check or "", ())])
            lines.append((f"{name} = {entry_text(entry)}", f"{mark}: {said}" if mark else said))
        return lines

    def _quantity_line(self, name: str, need: Need) -> tuple[str, str]:
        entry, usual = self.entries[name], typical(name, need)
        comment = meaning_in_card(need)
        if OPEN in entry.values():
            gauge = " gauge" if need.referenced else ""
            such = f", such as {usual}{gauge} ({usual.source})" if usual else ""
            comment = f"{FILL_IN}: {comment}{such}"
        hint = self.hints.get(name)
        return f"{name} = {entry_text(entry)}", f"{comment}; {hint}" if hint else comment


def draft_card(table: Table, rig: Rig, settings: Sequence[str] = ()) -> Draft:
    """The draft of a card for a table of a rig.

    Args:
        table: what the bench wrote.
        rig: class of the machine.
        settings: what the user knows, each as :data:`SETTING` says.

    Raises:
        InputError: settings that name nothing of the rig, or say what cannot be.
    """
    guesses = guess_columns(table, rig)
    needs, columns = schema.quantities(rig), schema.columns(rig)
    entries = {name: _open_entry(name, need) for name, need in needs.items() if need.required}
    parts: dict[str, str] = {}
    taken: dict[str, Quantity] = {}
    names = spelled({**{name: name for name in (*columns, *PARTS)}, **rig.quantities})
    problems = Problems("--set")
    for text in settings:
        name, equals, body = (part.strip() for part in text.partition("="))
        with problems.at(text):
            if not equals or not body:
                raise InputError(f"expected {SETTING}")
            name = resolve(names, name, f"rig {rig.rig!r}", "has no {}")
            if name in columns and (name not in needs or not NUMBER.fullmatch(body.split(":")[0].strip())):
                guesses[name] = _set_column(table, name, columns[name], guesses[name], body)
            elif name in PARTS:
                taken |= sheet_quantities(rig, name, body)
                parts[name] = body
            else:
                entries[name] = _set_quantity(name, needs[name], body)
    problems.check()
    taken = {name: q for name, q in taken.items() if OPEN in entries.get(name, {"value": OPEN}).values()}
    entries = {name: entry for name, entry in entries.items() if name not in taken}
    return Draft(rig, guesses, entries, _hints(table, rig, guesses), parts, taken)


def answered(draft: Draft, name: str, text: str) -> Draft:
    """A draft with the answer to one open quantity, written as a setting without its name.

    Raises:
        InputError: the answer is no value for it.
    """
    need = schema.quantities(draft.rig)[name]
    return dataclasses.replace(draft, entries={**draft.entries, name: _set_quantity(name, need, text)})


def _column_entry(rig: Rig, name: str, guess: Guess) -> Entry:
    need = schema.columns(rig)[name]
    unit = guess.unit if guess.unit is not None else OPEN
    entry: Entry = {"column": guess.column or OPEN, "unit": unit}
    if need.referenced:
        entry["reference"] = guess.reference or OPEN
    return entry


def _open_entry(name: str, need: Need) -> Entry:
    usual = typical(name, need)
    uncertain = {"std": OPEN} if usual is not None and usual.std is not None else {}
    reference = {"reference": OPEN} if need.referenced else {}
    return {"value": OPEN, **uncertain, "unit": card_unit(name, need), **reference}


def _default_line(rig: Rig, name: str, need: Need) -> tuple[str, str]:
    number, unit = default_in_card(rig, name) or (0.0, need.unit)
    entry: Entry = {"value": number, "unit": unit}
    if need.referenced:
        entry["reference"] = "absolute"
    return f"# {name} = {entry_text(entry)}", meaning_in_card(need)


def _set_column(table: Table, name: str, need: Need, guess: Guess, body: str) -> Guess:
    """A column as the user says; its unit and reference as guessed where they are not said."""
    # The name of a column may hold colons itself.
    column = next((c for c in (body, *_beginnings(body)) if c in table.columns), None)
    if column is None:
        name = body.split(":")[0]
        raise InputError(f"column {name!r} {table.absence(name)}")
    stamps = name == CLOCK.name and holds_stamps(table.entries(column))
    if not stamps and not np.isfinite(table.numbers_or_nan(column)).any():
        raise InputError(f"column {column!r} holds no numbers")
    unit, reference = _split_unit(body[len(column) :].lstrip(":"))
    if unit is not None or guess.column != column:
        entry: Entry = {"column": column, "unit": unit or guess.unit or OPEN}
        if need.referenced:
            entry["reference"] = reference or guess.reference or OPEN
        if OPEN not in entry.values():
            read_column(entry, need)
        told = OPEN not in entry.values() and (
            unit is not None and (reference is not None or not need.referenced)
        )
        said = () if told else ("its unit and reference are guesses",)
        return Guess(column, entry["unit"], entry.get("reference"), said, told)
    return dataclasses.replace(guess, said=(), sure=True)


def _beginnings(body: str) -> list[str]:
    parts = body.split(":")
    return [":".join(parts[:i]) for i in range(len(parts) - 1, 0, -1)]


def _set_quantity(name: str, need: Need, body: str) -> Entry:
    number, _, rest = body.partition(":")
    found = NUMBER.fullmatch(number.strip())
    if found is None:
        raise InputError(f"expected a number; got {number.strip()!r}. Write {SETTING}")
    unit, reference = _split_unit(rest)
    if need.referenced and reference is None:
        raise InputError("a pressure is gauge or absolute; write 7:bar:gauge")
    entry: Entry = {"value": float(found["value"])}
    if found["std"] is not None:
        entry["std"] = float(found["std"])
    entry["unit"] = card_unit(name, need) if unit is None else unit
    if reference is not None:
        entry["reference"] = reference
    read_quantity(entry, need, STANDARD_ATMOSPHERE)
    return entry


def _split_unit(text: str) -> tuple[str | None, str | None]:
    unit, _, reference = text.partition(":")
    return unit.strip() or None, reference.strip() or None


def _hints(table: Table, rig: Rig, guesses: Mapping[str, Guess]) -> dict[str, str]:
    """What the table tells of quantities that nobody can guess from it."""
    hints = {}
    columns = schema.columns(rig)
    for column in (c for c in rig.columns.values() if c.check == "valve command"):
        guess = guesses[column.name]
        if guess.column and guess.unit:
            hints["full_command"] = (
                f"the table goes to {np.nanmax(np.abs(table.numbers_or_nan(guess.column))):.4g} {guess.unit}"
            )
    pressures = [
        to_si(float(np.nanmax(table.numbers_or_nan(guess.column))), guess.unit, "Pa")
        for name, guess in guesses.items()
        if columns[name].referenced and guess.column and guess.unit
    ]
    if pressures:
        hints["supply_pressure"] = f"the table goes to {from_si(max(pressures), 'bar', 'Pa'):.4g} bar"
    return hints


def _aligned(lines: Sequence[tuple[str, str]]) -> list[str]:
    """Lines with their comments one below the other."""
    width = max((len(line) for line, comment in lines if comment and len(line) <= WIDTH), default=0)
    return [f"{line.ljust(width)}  # {comment}" if comment else line for line, comment in lines]
