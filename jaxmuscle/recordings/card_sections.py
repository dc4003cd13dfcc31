"""Validation of a card's sections against what its rig asks for, all faults told at once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import effect_named, names_on
from jaxmuscle.errors import InputError, Problems, UnknownNameError, nearest, nearest_or_own
from jaxmuscle.parameter_names import EFFECTS, resolve, spelled, split_effect
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card_rows import BREAKS, HELD_OUT, IGNORE, RowSpan, read_row_span
from jaxmuscle.recordings.data_sheets import PARTS, sheet_quantities
from jaxmuscle.recordings.schema import (
    AMBIENT,
    OPEN,
    ColumnSpec,
    Need,
    Quantity,
    Rig,
    example,
    read_column,
    read_deviation,
    read_quantity,
)
from jaxmuscle.units import STANDARD_ATMOSPHERE, out_of_range

HEADS = ("rig", "description")
SECTIONS = ("columns", *PARTS, "known", "uncertain", "effects", "noise", "fit", IGNORE, HELD_OUT, BREAKS)
NAME = re.compile(r"[A-Za-z0-9_-]+")
"""Keys of a card that are the user's own names."""
BOTH, PAST = STATES_FROM = ("both", "past")
"""By which samples a state with which a window begins is told: those of both sides, or those up to then."""
SUPPLY = "supply_pressure"
"""The quantity above which no pressure of a machine can rise for long."""


def read_sections(mapping: Mapping[str, Any], file: str) -> dict[str, Any]:
    """The fields of a card from the mapping that `tomllib` gives.

    Raises:
        InputError: with one line for each fault found.
    """
    name = _rig(mapping, file)
    rig, problems = RIGS[name], Problems(file)
    _unknown(mapping, (*HEADS, *SECTIONS), "top level", problems)
    description = mapping.get("description", "")
    if not isinstance(description, str):
        problems.add("description", f"expected a text; got {description!r}")
    sections = {section: _section(mapping, section, problems) for section in SECTIONS}
    parts, sheets = _parts({part: sections[part] for part in PARTS}, rig, problems)
    known, uncertain = _quantities(sections["known"], sections["uncertain"], sheets, rig, problems)
    fields = {
        "rig": name,
        "description": description,
        "columns": _columns(sections["columns"], rig, problems),
        "known": known,
        "uncertain": uncertain,
        "parts": parts,
        "effects": _effects(sections["effects"], rig, problems),
        "noise": _noise(sections["noise"], rig, problems),
        "horizon": _horizon(sections["fit"], problems),
        "state_from": _state_from(sections["fit"], problems),
        **{name: _row_spans(name, sections[name], rig, problems) for name in (IGNORE, HELD_OUT, BREAKS)},
    }
    problems.check()
    return fields


def _rig(mapping: Mapping[str, Any], file: str) -> str:
    name = mapping.get("rig")
    if not isinstance(name, str):
        got = "none is given" if name is None else f"got {name!r}"
        raise InputError(f"{file}: expected rig = one of {', '.join(RIGS)} before the first section; {got}")
    if name not in RIGS:
        raise InputError(f"{file}: unknown rig {name!r}{nearest(name, RIGS)}")
    return name


def _section(mapping: Mapping[str, Any], name: str, problems: Problems) -> Mapping[str, Any]:
    section = mapping.get(name, {})
    if isinstance(section, Mapping):
        return section
    problems.add(name, f"expected a section [{name}]; got {section!r}")
    return {}


def _unknown(given: Iterable[str], known: Iterable[str], where: str, problems: Problems) -> None:
    known = tuple(known)
    for name in given:
        if name not in known:
            problems.add(where, f"unknown {name!r}{nearest(name, known)}")


def _misnamed(
    entries: Mapping[str, Any], needs: Mapping[str, Need], rig: Rig, section: str, problems: Problems
) -> set[str]:
    """Note what is no quantity of the rig; returns those that are meant by another name of theirs.

    A card is edited in place, entry by entry, so that each stands under one name there.
    """
    found: set[str] = set()
    for name in (name for name in entries if name not in needs):
        written = _dotted(name, entries[name])
        effect, parameter = split_effect(written if written.startswith(EFFECTS) else EFFECTS + written)
        if effect is not None and parameter and effect in names_on(rig):
            place = f"a parameter of an effect; write {parameter} = … in [effects.{effect}]"
            problems.add(f"[{section}]", f"{written!r} is {place}")
            continue
        try:
            quantity = resolve(spelled(rig.quantities), written, f"[{section}]", "unknown {}")
        except UnknownNameError as error:
            problems.found.append(str(error))
        else:
            found.add(quantity)
            problems.add(f"[{section}]", f"{written!r} is {quantity!r} on a card; write {quantity} = …")
    return found


def _dotted(name: str, entry: object) -> str:
    """The name of an entry whose key has dots, which TOML reads as tables within each other."""
    while isinstance(entry, Mapping) and len(entry) == 1:
        ((key, inner),) = entry.items()
        if not isinstance(inner, Mapping):
            break
        name, entry = f"{name}.{key}", inner
    return name


def _missing(needs: Iterable[tuple[str, Need]], first: str, where: str, problems: Problems) -> None:
    lines = [f"\n      {name} = {example(need, first)}  # {need.meaning}" for name, need in needs]
    if lines:
        problems.add(where, f"{len(lines)} missing; add{''.join(lines)}")


def _columns(section: Mapping[str, Any], rig: Rig, problems: Problems) -> dict[str, ColumnSpec]:
    needs = schema.columns(rig)
    _unknown(section, needs, "[columns]", problems)
    absent = [(name, need) for name, need in needs.items() if name not in section]
    _missing(absent, 'column = "…"', "[columns]", problems)
    found: dict[str, ColumnSpec] = {}
    for name in (name for name in section if name in needs):
        with problems.at(f"[columns] {name}"):
            spec = read_column(section[name], needs[name])
            twin = next((other for other, taken in found.items() if taken.column == spec.column), None)
            if twin is not None:
                raise InputError(f"column {spec.column!r} is already the column of {twin}")
            found[name] = spec
    return found


def _parts(
    sections: Mapping[str, Mapping[str, Any]], rig: Rig, problems: Problems
) -> tuple[dict[str, str], dict[str, Quantity]]:
    """Part → type, and the quantities that their data sheets give."""
    types: dict[str, str] = {}
    sheets: dict[str, Quantity] = {}
    for part, section in ((part, section) for part, section in sections.items() if section):
        _unknown(section, ("type",), f"[{part}]", problems)
        with problems.at(f"[{part}] type"):
            if section.get("type") == OPEN:
                raise InputError(f"still to be filled in; name it in place of {OPEN!r}, or remove [{part}]")
            sheets |= sheet_quantities(rig, part, section.get("type"))
            types[part] = section["type"]
    return types, sheets


def _quantities(
    known: Mapping[str, Any],
    uncertain: Mapping[str, Any],
    sheets: Mapping[str, Quantity],
    rig: Rig,
    problems: Problems,
) -> tuple[dict[str, Quantity], dict[str, Quantity]]:
    """(known, uncertain) quantities; those with a standard deviation are uncertain wherever they stand.

    `sheets`: those that stand in neither section if the card does not give them.
    """
    needs = schema.quantities(rig)
    given = {"known": known, "uncertain": uncertain}
    meant: set[str] = set()
    for section, entries in given.items():
        meant |= _misnamed(entries, needs, rig, section, problems)
    there = {*known, *uncertain, *sheets, *meant}
    absent = [(n, need) for n, need in needs.items() if need.required and n not in there]
    _missing(absent, "value = …", "[known]", problems)
    for name in (name for name in known if name in uncertain):
        problems.add(f"[known] {name}", "also given in [uncertain]; remove one of the two")
    entries = [(s, name, entry) for s in given for name, entry in given[s].items() if name in needs]
    # Gauge pressures need the ambient pressure.
    entries.sort(key=lambda entry: entry[1] != AMBIENT)
    found = {name: quantity for name, quantity in sheets.items() if name not in {**known, **uncertain}}
    for section, name, entry in entries:
        with problems.at(f"[{section}] {name}"):
            ambient = found[AMBIENT].value if AMBIENT in found else STANDARD_ATMOSPHERE
            found[name] = read_quantity(entry, needs[name], ambient)
            if section == "uncertain" and found[name].std is None:
                raise InputError("expected a standard deviation, std = …; add it or move the line to [known]")
            if name == SUPPLY and found[name].value <= ambient:
                raise InputError('is not above the ambient pressure; is it reference = "gauge"?')
            shift = ambient if found[name].reference == "gauge" else 0.0
            wrong = out_of_range(name, found[name].value, found[name].unit, needs[name].unit, shift)
            if wrong is not None:
                found.pop(name)
                raise InputError(wrong)
    with_std = {name: quantity for name, quantity in found.items() if quantity.std is not None}
    return {name: q for name, q in found.items() if name not in with_std}, with_std


def _effects(section: Mapping[str, Any], rig: Rig, problems: Problems) -> dict[str, dict[str, Quantity]]:
    found: dict[str, dict[str, Quantity]] = {}
    for name, entries in section.items():
        where = f"[effects.{name}]"
        effect = effect_named(name)
        if effect is None:
            told = nearest_or_own(name, names_on(rig), "jaxmuscle.effects.register")
            problems.add(where, f"unknown effect{told}")
        elif not isinstance(entries, Mapping):
            problems.add(where, f"expected a section with the effect's parameters; got {entries!r}")
        elif not rig.offers(effect := rig.effect_named(name)):
            lacking = ", ".join(sorted(effect.reads - rig.readable()))
            problems.add(where, f"rig {rig.rig!r} cannot have this effect: it has no signal {lacking}")
        else:
            found[name] = _effect(entries, schema.effect_parameters(effect, rig), where, problems)
    return found


def _effect(
    entries: Mapping[str, Any], needs: Mapping[str, Need], where: str, problems: Problems
) -> dict[str, Quantity]:
    _unknown(entries, needs, where, problems)
    absent = [(name, need) for name, need in needs.items() if need.required and name not in entries]
    _missing(absent, "value = …", where, problems)
    found: dict[str, Quantity] = {}
    for name in (name for name in entries if name in needs):
        with problems.at(f"{where} {name}"):
            found[name] = read_quantity(entries[name], needs[name], 0.0)
    return found


def _measured(rig: Rig) -> dict[str, Need]:
    return {name: need for name, need in schema.columns(rig).items() if name not in ("time", *rig.commands)}


def _noise(section: Mapping[str, Any], rig: Rig, problems: Problems) -> dict[str, float]:
    needs = _measured(rig)
    _unknown(section, needs, "[noise]", problems)
    found: dict[str, float] = {}
    for name in (name for name in section if name in needs):
        with problems.at(f"[noise] {name}"):
            found[name] = read_deviation(section[name], needs[name])
    return found


def _horizon(section: Mapping[str, Any], problems: Problems) -> float | None:
    _unknown(section, ("horizon", "state_from"), "[fit]", problems)
    if "horizon" in section:
        with problems.at("[fit] horizon"):
            need = Need("s", "length of the windows of prediction", positive=True)
            return read_quantity(section["horizon"], need, 0.0, keys=("value", "unit")).value
    return None


def _state_from(section: Mapping[str, Any], problems: Problems) -> str:
    with problems.at("[fit]"):
        return check_state_from(section.get("state_from", BOTH))
    return BOTH


def check_state_from(given: object) -> str:
    """`given`, if it is one of :data:`STATES_FROM`.

    Raises:
        InputError: it is not.
    """
    if isinstance(given, str) and given in STATES_FROM:
        return given
    raise InputError(
        f'state_from: expected "{PAST}", for windows that begin with the state as samples before it tell, '
        f'or "{BOTH}", as samples of both sides do; got {given!r}'
    )


def _row_spans(name: str, section: Mapping[str, Any], rig: Rig, problems: Problems) -> dict[str, RowSpan]:
    found: dict[str, RowSpan] = {}
    for key, entry in section.items():
        with problems.at(f"[{name}] {key}"):
            if not NAME.fullmatch(key):
                raise InputError("expected a name of letters, digits, - and _; rename it")
            found[key] = read_row_span(name, entry, _measured(rig))
    return found
