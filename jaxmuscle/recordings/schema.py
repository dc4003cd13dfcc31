"""Entries that a rig asks of a card and of a table, read off the rig's class (no rig is named here), and one
such entry, ``{ value = 300, std = 1, unit = "mm" }``, read into SI and written back.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, get_type_hints

import equinox as eqx

import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.variables import Column
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import Declaration, declared_at
from jaxmuscle.units import check_unit, example_unit, from_si, scale, to_si

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


@functools.cache
def quantities(rig: Rig) -> Mapping[str, Need]:
    """The quantities of a rig's card by name, in the rig's order."""
    needs = {}
    for name, path in rig.quantities.items():
        need = _need(declared_at(rig, path), rig)
        needs[name] = dataclasses.replace(need, referenced=need.unit == "Pa" and name != AMBIENT)
    return MappingProxyType(needs)


def default(rig: Rig, name: str) -> float | None:
    """The value (SI) of a quantity that a card leaves out; `None` of one that it has to give."""
    found = declared_at(rig, rig.quantities[name]).default
    return None if found is dataclasses.MISSING else float(found)


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
    """The machine with the given values (SI) at dotted paths, defaults elsewhere, and with effects.

    Raises:
        InputError: a parameter without a default has no value, as `quantities` of the rig does not name it.
    """
    if lacking := [path for path in _required(rig) if path not in values]:
        raise InputError(
            f"{rig.__name__}: expected a value of {', '.join(lacking)}, which has no default; there is none. "
            f"Name it in the rig's quantities, {{{lacking[0].rpartition('.')[2]!r}: {lacking[0]!r}}}, "
            f"so that a card can give it, or declare a default"
        )
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *components, name = path.split(".")
        node = tree
        for component in components:
            node = node.setdefault(component, {})
        node[name] = value
    return _built(rig, {**tree, "effects": dict(effects)})


def _required(cls: type[Any], inside: str = "") -> Iterator[str]:
    """Dotted paths of the parameters of a machine, and of its components, that have no default."""
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        hint, none = hints[field.name], dataclasses.MISSING
        if isinstance(hint, type) and issubclass(hint, eqx.Module):
            yield from _required(hint, f"{inside}{field.name}.")
        elif "unit" in field.metadata and field.default is none and field.default_factory is none:
            yield inside + field.name


def _built(cls: type[Any], tree: Mapping[str, Any]) -> Any:
    arguments = dict(tree)
    for name, hint in get_type_hints(cls).items():
        if isinstance(hint, type) and issubclass(hint, eqx.Module):
            arguments[name] = _built(hint, tree.get(name, {}))
    return cls(**arguments)


def _need(field: dataclasses.Field[Any], rig: Rig) -> Need:
    required = field.default is dataclasses.MISSING
    return Need(**vars(Declaration.of(field, rig.unit_templates)), required=required)


REFERENCES = ("gauge", "absolute")
OPEN = "?"
"""What stands in a drafted card in place of what nobody has said yet."""
HUGE = 1e300
"""No number of a card can be meant beyond this."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A quantity of a card in SI, pressures absolute, with the unit and reference in which it is written."""

    value: float
    std: float | None = None
    unit: str = ""
    reference: str | None = None


@dataclasses.dataclass(frozen=True)
class ColumnSpec:
    """Where a quantity stands in the table: name of the column, its unit, and gauge or absolute."""

    column: str
    unit: str
    reference: str | None = None


def read_quantity(
    entry: object, need: Need, ambient: float, keys: tuple[str, ...] = ("value", "std", "unit", "reference")
) -> Quantity:
    """A quantity from its entry; `ambient` [Pa] is added to gauge pressures.

    Raises:
        InputError: the entry is not what `need` asks for; the message does not repeat its name.
    """
    table = _inline_table(entry, keys, example(need))
    unit = _unit(table, need)
    reference = _reference(table, need)
    value = to_si(_number(table, "value"), unit, need.unit) + _shift(reference, ambient)
    if need.positive and value <= 0:
        raise InputError(f"has to be above zero; got value = {table['value']}")
    if need.unit == "rad" and abs(value) > 2 * math.pi:
        raise InputError(f'{table["value"]} {unit} is more than a full turn; is it unit = "deg"?')
    std = _deviation(table, "std", unit, need) if "std" in table else None
    return Quantity(value, std, unit, reference)


def read_deviation(entry: object, need: Need) -> float:
    """A standard deviation (SI) from an entry ``{ value = …, unit = … }``; errors as in `read_quantity`."""
    difference = dataclasses.replace(need, referenced=False)
    table = _inline_table(entry, ("value", "unit"), example(difference))
    return _deviation(table, "value", _unit(table, need), need)


def read_column(entry: object, need: Need) -> ColumnSpec:
    """The specification of a column from its entry; errors as in `read_quantity`."""
    wanted = example(need, 'column = "…"')
    table = _inline_table(entry, ("column", "unit", "reference"), wanted)
    column = table.get("column")
    if not isinstance(column, str):
        got = f"got column = {column!r}" if "column" in table else "none is given"
        raise InputError(f"expected the name of a column of the table, {wanted}; {got}")
    return ColumnSpec(column, _unit(table, need), _reference(table, need))


def written_quantity(quantity: Quantity, need: Need, ambient: float) -> dict[str, Any]:
    """The entry that reads back as `quantity`."""
    unit, shift = quantity.unit, _shift(quantity.reference, ambient)
    number = from_si(quantity.value - shift, unit, need.unit)
    entry: dict[str, Any] = {
        "value": _shortest(number, quantity.value, lambda x: to_si(x, unit, need.unit) + shift)
    }
    if quantity.std is not None:
        entry["std"] = written_deviation(quantity.std, unit, need)
    entry["unit"] = unit
    if quantity.reference is not None:
        entry["reference"] = quantity.reference
    return entry


def written_deviation(std: float, unit: str, need: Need) -> float:
    """The number that reads back as the standard deviation `std` (SI) when it is given in `unit`."""
    factor = scale(unit, need.unit)
    return _shortest(std / factor, std, lambda number: number * factor)


def example(need: Need, first: str = "value = …") -> str:
    """How an entry for `need` is written."""
    reference = ', reference = "gauge"' if need.referenced else ""
    return f'{{ {first}, unit = "{example_unit(need.unit)}"{reference} }}'


def _inline_table(entry: object, keys: tuple[str, ...], wanted: str) -> Mapping[str, Any]:
    if not isinstance(entry, Mapping):
        raise InputError(f"expected {wanted}; got {entry!r}")
    for key in entry:
        if key not in keys:
            raise InputError(f"unknown key {key!r}{nearest(key, keys)}")
    if left := [key for key in entry if entry[key] == OPEN]:
        raise InputError(
            f"still to be filled in: {' and '.join(left)}; write what you know in place of {OPEN!r}"
        )
    return entry


def _unit(table: Mapping[str, Any], need: Need) -> str:
    unit = table.get("unit", "" if need.unit == "" else None)
    if not isinstance(unit, str):
        wanted = f'unit = "{example_unit(need.unit)}"'
        got = f"got unit = {unit!r}" if "unit" in table else "none is given"
        raise InputError(f"expected a unit, such as {wanted}; {got}")
    check_unit(unit, need.unit)
    return unit


def _reference(table: Mapping[str, Any], need: Need) -> str | None:
    reference = table.get("reference")
    if need.referenced and reference not in REFERENCES:
        got = "none is given" if reference is None else f"got {reference!r}"
        raise InputError(f'expected reference = "gauge" or reference = "absolute" for a pressure; {got}')
    if not need.referenced and reference is not None:
        why = "it is a difference" if need.difference else "only pressures have one"
        why = "it is always absolute" if need.unit == "Pa" and not need.difference else why
        raise InputError(f"takes no reference, {why}; remove reference = {reference!r}")
    return reference


def _number(table: Mapping[str, Any], key: str) -> float:
    number = table.get(key)
    if isinstance(number, bool) or not isinstance(number, int | float) or not -HUGE < number < HUGE:
        got = f"got {key} = {repr(number)[:40]}" if key in table else "none is given"
        raise InputError(f"expected a finite number as {key}; {got}")
    return float(number)


def _deviation(table: Mapping[str, Any], key: str, unit: str, need: Need) -> float:
    number = _number(table, key)
    if number <= 0:
        raise InputError(f"a standard deviation has to be above zero; got {key} = {number:g}")
    return number * scale(unit, need.unit)


def _shift(reference: str | None, ambient: float) -> float:
    return ambient if reference == "gauge" else 0.0


def _shortest(number: float, wanted: float, read_back: Callable[[float], float]) -> float:
    """`number` with as few digits as still read back as `wanted`."""
    rounded = (float(f"{number:.{digits}g}") for digits in range(1, 18))
    return next((short for short in rounded if read_back(short) == wanted), number)
