"""Variables of a rig as it declares them: states, commands and readings with names, units and columns."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal

from jaxmuscle.errors import InputError

Check = Literal[
    "valve command",
    "muscle pressure",
    "regulated pressure",
    "contraction",
    "lift",
    "muscle force",
    "joint angle",
]
CHECKS: dict[str, tuple[str | None, bool]] = {
    "valve command": (None, False),
    "muscle pressure": ("Pa", False),
    "regulated pressure": ("Pa", True),
    "contraction": ("m", False),
    "lift": ("m", False),
    "muscle force": ("N", False),
    "joint angle": ("rad", True),
}
"""What a column can be held to when a recording is read, its unit, and whether several columns can be.

By what the card says of valve and muscle: the command of a valve that `full_command` opens; the pressure in
the one muscle of the card; pressures that follow the commands one by one; the shortening of that muscle, by a
test machine or where it lifts the card's `mass` off a base plate; its pull; angles of joints that two such
muscles turn on a sprocket.
"""

SYMBOLS = frozenset("m kg s A K mol cd rad sr Hz N Pa J W C V F ohm S Wb T H lm lx".split())
"""Units without a factor against the base units: products of powers of them are SI throughout."""
FACTOR = re.compile(r"(?P<symbol>[A-Za-z]+)(\^-?\d+(\.\d+)?)?|1")
"""One factor of a unit."""
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""What can stand in a card without quotation marks and in a path without a dot."""


@dataclasses.dataclass(frozen=True)
class Column:
    """One column of a recording.

    Attributes:
        name: by which the card calls it; letters, digits, underscores.
        unit: SI unit, of base and derived units without a prefix: ``"N m"``, ``"kg/s"``, ``"K"``, ``""`` for
            a plain number. A card may give the column in any unit of the same kind.
        difference: whether it is a difference of two pressures or of two temperatures: such a pressure is
            neither gauge nor absolute, and such a temperature has no zero of its own (1 degC is 1 K).
        check: what it is held to when a recording is read, of :data:`CHECKS`; nothing when `None`.
    """

    name: str
    unit: str
    difference: bool = False
    check: Check | None = None

    @property
    def referenced(self) -> bool:
        """Whether it is a pressure against vacuum or ambient, which a card has to say."""
        return self.unit == "Pa" and not self.difference


@dataclasses.dataclass(frozen=True)
class Command(Column):
    """One column of the command, held from its sample to the next."""


@dataclasses.dataclass(frozen=True)
class StateVariable:
    """One state of a rig, a number or an array, that is integrated or that the bench imposes.

    Attributes:
        name: its key among the states.
        unit, difference, check: as of a :class:`Column`.
        columns: those that measure it, one for each entry; none where it is hidden.
        rest: its value when a run begins and nothing else is said (SI), or the path of a parameter of the
            rig, such as ``"ambient_pressure"``. Of a measured one; :meth:`AbstractActuator.rest` gives the
            hidden ones.
        rate: name of the state that is its rate, at rest zero, found from the columns by differentiation.
        imposed: whether the bench imposes it, and its rate; it is then never predicted.
    """

    name: str
    unit: str
    columns: tuple[str, ...] = ()
    rest: float | str = 0.0
    rate: str | None = None
    imposed: bool = False
    difference: bool = False
    check: Check | None = None


@dataclasses.dataclass(frozen=True)
class Reading:
    """What sensors show and the model has to predict: one link of the chain.

    Attributes:
        name: its key among the readings.
        unit, columns, difference, check: as of a :class:`StateVariable`; those of the measured state of the
            same name when not given.
        given: measured states and rates that are taken as measured where this reading is predicted.
        signal: the signal of the chain on which its residual bears; its own name when not given.
    """

    name: str
    unit: str | None = None
    columns: tuple[str, ...] = ()
    given: tuple[str, ...] = ()
    signal: str | None = None
    difference: bool = False
    check: Check | None = None


Variable = Command | StateVariable | Reading


@dataclasses.dataclass(frozen=True)
class Link:
    """One link of the chain: `output` is predicted while the states `imposed` are taken as measured.

    `signal` is the signal of the chain on which the link's residual bears.
    """

    output: str
    imposed: tuple[str, ...]
    signal: str


def rate_unit(unit: str) -> str:
    """The unit of a rate: ``m`` → m/s, ``m/s`` → m/s^2, a plain number → 1/s."""
    if not unit:
        return "1/s"
    return f"{unit.removesuffix('/s')}/s^2" if unit.endswith("/s") else f"{unit}/s"


def column_units(columns: Iterable[Column]) -> dict[str, str]:
    """Units of columns and of their rates, as units of parameters name them: ``{column force}``."""
    columns = tuple(columns)
    rates = {f"rate {column.name}": rate_unit(column.unit) for column in columns}
    return {**{f"column {column.name}": column.unit for column in columns}, **rates}


def class_variables(
    rig: str, variables: tuple[Variable, ...], units: Mapping[str, str], paths: set[str]
) -> dict[str, Any]:
    """What follows from a rig's `variables`: the class variables that the rest of the package reads.

    Args:
        rig: what messages call it.
        units: those that the rig declares of load and motion.
        paths: names of the rig's fields, in which the paths of states' rests begin.

    Raises:
        InputError: what is declared is no variable, contradicts itself or names what is not there.
    """
    for entry in variables:
        if not isinstance(entry, Command | StateVariable | Reading):
            raise InputError(
                f"{rig}: variables: expected each a Command, StateVariable or Reading; got {entry!r}"
            )
    commands = [v for v in variables if isinstance(v, Command)]
    states = {v.name: v for v in variables if isinstance(v, StateVariable)}
    _check_names(rig, variables)
    for state in states.values():
        _check_state(rig, state, paths)
    rates = {s.rate: StateVariable(s.rate, rate_unit(s.unit)) for s in states.values() if s.rate}
    if twice := sorted(rates.keys() & states.keys()):
        raise InputError(f"{rig}: {twice[0]!r} is declared as a rate and as a state; leave out the state")
    readings = [_completed(rig, v, states) for v in variables if isinstance(v, Reading)]
    measured = {s.name: s.columns for s in states.values() if s.columns}
    for reading in readings:
        _check_given(rig, reading, {*measured, *rates})
    imposed = [s for s in states.values() if s.imposed]
    first = {"command": commands[0].unit} if commands else {}
    return {
        "units": {**first, **{name: unit for name, unit in units.items() if name != "command"}},
        "columns": _columns(rig, (*commands, *states.values(), *readings)),
        "states": {**states, **rates},
        "commands": tuple(command.name for command in commands),
        "measured": measured,
        "derivatives": {s.rate: s.name for s in states.values() if s.rate},
        "imposed": (*(s.name for s in imposed), *(s.rate for s in imposed if s.rate)),
        "outputs": {r.name: r.columns for r in readings},
        "links": tuple(Link(r.name, r.given, r.signal or r.name) for r in readings),
    }


def _check_names(rig: str, variables: tuple[Variable, ...]) -> None:
    for kind in (Command, StateVariable, Reading):
        names = [v.name for v in variables if isinstance(v, kind)]
        for name in names:
            if not NAME.fullmatch(name):
                raise InputError(f"{rig}: expected names of letters, digits and underscores; got {name!r}")
            if names.count(name) > 1:
                raise InputError(f"{rig}: two variables of kind {kind.__name__} are named {name!r}")


def _check_state(rig: str, state: StateVariable, paths: set[str]) -> None:
    where = f"{rig}: state {state.name!r}"
    _check_columns(where, state.columns)
    check_si(where, state.unit)
    hidden = not state.columns
    if hidden and (state.rate or state.imposed):
        what = "imposed" if state.imposed else f"differentiated to {state.rate!r}"
        raise InputError(f"{where} is {what}; expected the columns that measure it")
    if hidden and state.rest != 0.0:
        raise InputError(f"{where} is hidden: the method rest says where it begins; leave out rest=")
    if isinstance(state.rest, str) and state.rest.partition(".")[0] not in paths:
        raise InputError(f"{where} rests at {state.rest!r}: expected a number or the path of a parameter")


def _check_columns(where: str, columns: object) -> None:
    names = columns if isinstance(columns, tuple) else ()
    if not isinstance(columns, tuple) or not all(isinstance(name, str) for name in names):
        raise InputError(
            f'{where}: expected columns as a tuple of names, such as ("angle",); got {columns!r}'
        )


def _completed(rig: str, reading: Reading, states: Mapping[str, StateVariable]) -> Reading:
    """The reading with unit and columns, those of a measured state where it is one."""
    where, same = f"{rig}: reading {reading.name!r}", states.get(reading.name)
    _check_columns(where, reading.columns)
    if same is not None and same.columns:
        if same.imposed:
            raise InputError(f"{where}: the bench imposes that state; it cannot be predicted")
        unit, columns = reading.unit or same.unit, reading.columns or same.columns
        if (unit, columns) != (same.unit, same.columns):
            raise InputError(
                f"{where}: {', '.join(columns)} in {unit!r}, but the state of that name is measured by "
                f"{', '.join(same.columns)} in {same.unit!r}; leave out unit and columns"
            )
        return dataclasses.replace(
            reading, unit=unit, columns=columns, difference=same.difference, check=same.check
        )
    if reading.unit is None or not reading.columns:
        raise InputError(f"{where}: no measured state has that name; expected its unit and its columns")
    check_si(where, reading.unit)
    return reading


def _check_given(rig: str, reading: Reading, known: set[str]) -> None:
    for name in reading.given:
        if name not in known or name == reading.name:
            others = ", ".join(sorted(known - {reading.name})) or "none"
            raise InputError(
                f"{rig}: reading {reading.name!r} is given {name!r}; expected measured states or rates, "
                f"of {others}"
            )


def _columns(rig: str, variables: tuple[Variable, ...]) -> dict[str, Column]:
    """Every column by its name, in the order of declaration; none may mean two things."""
    found: dict[str, Column] = {}
    for v in variables:
        names = (v.name,) if isinstance(v, Command) else v.columns
        for name in names:
            if not NAME.fullmatch(name) or name == "time":
                raise InputError(
                    f"{rig}: column {name!r}: expected letters, digits and underscores, and not time"
                )
            column = Column(name, v.unit or "", v.difference, v.check)
            check_si(f"{rig}: column {name!r}", column.unit)
            if name in found and found[name] != column:
                raise InputError(f"{rig}: column {name!r} is declared twice: {found[name]} and {column}")
            found[name] = column
    _check_checks(rig, found.values())
    return found


def _check_checks(rig: str, columns: Iterable[Column]) -> None:
    """Raise `InputError` for a check that there is not, of another unit, or of more columns than it takes."""
    held: dict[str, str] = {}
    for column in columns:
        if column.check is None:
            continue
        where = f"{rig}: column {column.name!r}"
        if column.check not in CHECKS:
            raise InputError(f"{where}: expected check of {', '.join(CHECKS)}; got {column.check!r}")
        unit, several = CHECKS[column.check]
        if unit not in (None, column.unit) or column.difference:
            raise InputError(f"{where}: check {column.check!r} is for a column in {unit}")
        if column.check in held and not several:
            raise InputError(
                f"{where}: check {column.check!r} is for one column; {held[column.check]} has it"
            )
        held[column.check] = column.name


def check_si(where: str, unit: object) -> None:
    """Raise `InputError` unless a unit is a product of powers of SI units without a factor."""
    text = unit if isinstance(unit, str) else "?"
    factors = [FACTOR.fullmatch(part) for part in re.split(r"[\s*/()]+", text) if part]
    if not all(found and found["symbol"] in {None, *SYMBOLS} for found in factors):
        raise InputError(
            f"{where}: expected an SI unit without prefix, its factors apart, such as 'N m', 'kg/s', 'K' or "
            f"'' for a plain number; got {unit!r}. A card may give another unit of the same kind"
        )
