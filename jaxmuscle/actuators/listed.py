"""Rigs declared in the older form, by class variables, with columns of a few names whose units are listed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jaxmuscle.actuators.variables import Column, StateVariable, rate_unit

LISTED_UNITS = {
    "pressure": "Pa",
    "supply_pressure": "Pa",
    "position": "m",
    "angle": "rad",
    "force": "N",
    "current": "A",
}
"""Column of the older form → its SI unit; a number that tells muscles apart ("pressure_1") is left out."""
OLDER = ("commands", "measured", "derivatives", "imposed", "outputs", "links")
"""Class variables of the older form; `variables` has the place of all of them."""


def listed_variables(older: Mapping[str, Any], command: str | None, paths: set[str]) -> dict[str, Any]:
    """Columns and states of a rig in the older form, as far as their units are listed.

    Columns of pressure are absolute; a state that they measure rests at the rig's `ambient_pressure`.

    Args:
        older: the class variables `OLDER`.
        command: unit of the command.
        paths: names of the rig's fields.
    """
    names = (*older["commands"], *_names(older["measured"]), *_names(older["outputs"]))
    units = {name: _listed_unit(name, command) for name in names}
    columns = {name: Column(name, unit) for name, unit in units.items() if unit is not None}
    rates = {base: rate for rate, base in older["derivatives"].items()}
    states: dict[str, StateVariable] = {}
    for name, group in older["measured"].items():
        unit = units[group[0]] or ""
        rest = "ambient_pressure" if unit == "Pa" and "ambient_pressure" in paths else 0.0
        imposed = name in older["imposed"]
        states[name] = StateVariable(name, unit, group, rest, rates.get(name), imposed)
    for rate, base in older["derivatives"].items():
        states[rate] = StateVariable(rate, rate_unit(states[base].unit))
    return {"columns": columns, "states": states}


def _names(groups: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(name for group in groups.values() for name in group)


def _listed_unit(column: str, command: str | None) -> str | None:
    """SI unit of a column, `None` for one of another name."""
    stem = column.rstrip("0123456789").removesuffix("_")
    return command if stem == "command" and command else LISTED_UNITS.get(stem)
