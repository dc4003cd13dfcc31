"""What a rig asks of a card and of a table, read off the rig's class; no rig is named here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, get_type_hints

import equinox as eqx

import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.actuators.variables import Column
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.parameters import Declaration, declared_at

AMBIENT = "ambient_pressure"
"""The quantity to which gauge pressures are relative; itself always absolute."""

CLOCK = Column("time", "s")
"""The column that every table has."""

Rig = type[AbstractActuator]


@dataclasses.dataclass(frozen=True)
class Need(Declaration):
    """A number that a card may or must give.

    Attributes:
        required: whether the card has to give it.
        referenced: whether it is a pressure against vacuum or ambient, which the card has to say.
        difference: whether it is a difference, of which a unit's offset is no part (degC).
    """

    required: bool = True
    referenced: bool = False
    difference: bool = False


def quantities(rig: Rig) -> dict[str, Need]:
    """The quantities of a rig's card by name, in the rig's order."""
    needs = {}
    for name, path in rig.quantities.items():
        need = _need(declared_at(rig, path), rig)
        needs[name] = dataclasses.replace(need, referenced=need.unit == "Pa" and name != AMBIENT)
    return needs


def effect_parameters(effect: type[AbstractEffect], rig: Rig) -> dict[str, Need]:
    """The parameters of an effect on a rig; pressures among them are differences."""
    return {field.name: _need(field, rig) for field in dataclasses.fields(effect) if "unit" in field.metadata}


def columns(rig: Rig) -> dict[str, Need]:
    """The quantities that a table for a rig has to hold: time, commands, everything measured."""
    groups = ((CLOCK.name,), rig.commands, *rig.measured.values(), *rig.outputs.values())
    names = dict.fromkeys(name for group in groups for name in group)
    return {name: _column(rig, name) for name in names}


def _column(rig: Rig, name: str) -> Need:
    column = CLOCK if name == CLOCK.name else rig.column(name)
    return Need(
        column.unit,
        f"samples of {name}",
        referenced=column.referenced,
        difference=column.difference,
    )


def imposed_columns(rig: Rig) -> tuple[str, ...]:
    """The columns by which the bench moves the machine: its commands, or the states it imposes."""
    imposed = [column for state in rig.imposed for column in rig.measured.get(state, ())]
    return (*rig.commands, *imposed)


def predicted_columns(rig: Rig) -> tuple[str, ...]:
    """The columns that a model of the rig has to predict."""
    return tuple(column for group in rig.outputs.values() for column in group)


def build(rig: Rig, values: Mapping[str, float], effects: Mapping[str, AbstractEffect]) -> AbstractActuator:
    """The machine with the given values (SI) at dotted paths, defaults elsewhere, and with effects."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *components, name = path.split(".")
        node = tree
        for component in components:
            node = node.setdefault(component, {})
        node[name] = value
    return _built(rig, {**tree, "effects": dict(effects)})


def _built(cls: type[Any], tree: Mapping[str, Any]) -> Any:
    arguments = dict(tree)
    for name, hint in get_type_hints(cls).items():
        if isinstance(hint, type) and issubclass(hint, eqx.Module):
            arguments[name] = _built(hint, tree.get(name, {}))
    return cls(**arguments)


def _need(field: dataclasses.Field[Any], rig: Rig) -> Need:
    required = field.default is dataclasses.MISSING
    return Need(**vars(Declaration.of(field, rig.units)), required=required)
