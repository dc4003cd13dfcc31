"""Control channel of a rig: the reading that a controller takes, and what its output does to the commands."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Set
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.variables import check_si
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import get

Entry = float | str
"""A number in SI, or the path of a parameter of the rig, after a minus sign for its negative."""
Entries = Entry | tuple[Entry, ...]
"""The same for all commands, or one for each."""


class Actuation(NamedTuple):
    r"""What an output u of a controller does to the commands: :math:`c = c_0 + d\,u`, limited.

    Arrays with one entry a command, or numbers: c0 `rest`, the command at an output of zero; d `direction`,
    command per output; `lowest` and `highest` command.
    """

    rest: Array
    direction: Array
    lowest: Array
    highest: Array


@dataclasses.dataclass(frozen=True)
class ControlChannel:
    """The reading that a controller sees on a rig, and what its output does to the commands.

    Attributes:
        reading: name of an output of the rig.
        unit: SI unit of the controller's output; that of the first command when not given.
        rest, direction, lowest, highest: as of :class:`Actuation`; numbers in SI or paths of parameters, a
            tuple where the commands differ. A rig whose entries are more than that has a method
            :meth:`AbstractActuator.actuation` of its own.
    """

    reading: str
    unit: str | None = None
    rest: Entries = 0.0
    direction: Entries = 1.0
    lowest: Entries = -math.inf
    highest: Entries = math.inf

    def actuation(self, model: eqx.Module, commands: int) -> Actuation:
        """Its entries at the parameters of a model with so many commands."""
        shape = (commands,) if commands > 1 else ()
        return Actuation(*(_filled(model, entries, shape) for entries in self._entries))

    @property
    def _entries(self) -> tuple[Entries, ...]:
        return self.rest, self.direction, self.lowest, self.highest

    def checked(
        self, rig: str, units: Mapping[str, str], outputs: Mapping[str, Any], commands: int, paths: Set[str]
    ) -> ControlChannel:
        """Itself, with its unit, after a look at it beside the rest of the rig.

        Args:
            rig: what messages call it.
            units, outputs: of the rig; commands: their number; paths: names of its fields.

        Raises:
            InputError: no such reading or parameter, a unit that is none, entries that are not one for all
                commands or one for each.
        """
        where = f"{rig}: channel"
        if self.reading not in outputs:
            raise InputError(
                f"{where}: expected one of the readings {', '.join(outputs)}; got {self.reading!r}"
            )
        if not commands:
            raise InputError(f"{where}: the rig has no command for a controller to give")
        unit = units["command"] if self.unit is None else self.unit
        check_si(where, unit)
        for entries in self._entries:
            if isinstance(entries, tuple) and len(entries) != commands:
                raise InputError(f"{where}: expected one entry, or {commands}; got {entries}")
            for entry in _each(entries):
                if isinstance(entry, str) and entry.removeprefix("-").partition(".")[0] not in paths:
                    raise InputError(f"{where}: expected a number or the path of a parameter; got {entry!r}")
        return dataclasses.replace(self, unit=unit)


def _each(entries: Entries) -> Iterator[Entry]:
    yield from entries if isinstance(entries, tuple) else (entries,)


def _value(model: eqx.Module, entry: Entry) -> Array:
    if isinstance(entry, str):
        value = get(model, entry.removeprefix("-"))
        return -value if entry.startswith("-") else value
    return jnp.asarray(entry, dtype=float)


def _filled(model: eqx.Module, entries: Entries, shape: tuple[int, ...]) -> Array:
    values = [_value(model, entry) for entry in _each(entries)]
    return jnp.broadcast_to(jnp.stack(values) if isinstance(entries, tuple) and shape else values[0], shape)
