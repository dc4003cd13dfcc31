"""The names by which a fit's parameters are called: card quantities, dotted paths, offsets of sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import Parameter, entries_of, get, parameters

OFFSET = "offset."
"""Prefix of the constant that a sensor adds to its column: ``offset.position``."""
START = "start."
"""Prefix of a state at the first sample of a recording: ``start.opening``."""


def of_machine(path: str) -> bool:
    """Whether a path leads into the machine, not to a sensor or to the beginning of a recording."""
    return not path.startswith((OFFSET, START))


@dataclasses.dataclass(frozen=True)
class Place:
    """One number that a fit can move: a leaf of the machine, the offset of a sensor, an initial state.

    Attributes:
        name: what results call it: the card's name of a quantity, else its path.
        path: where it is in the machine; ``offset.COLUMN`` for the offset of a column, ``start.STATE`` for a
            state at the first sample.
        value: its value in the machine (SI); 0 for an offset.
        typical: natural size (SI) of one whose value is zero, when it is known; of an offset or of an initial
            state how far it may well be from where it begins.
        shape: of a whole array, which is fitted entry by entry; its `value` is NaN.
    """

    name: str
    path: str
    value: float
    unit: str
    meaning: str
    positive: bool = False
    nonnegative: bool = False
    typical: float | None = None
    shape: tuple[int, ...] = ()

    @property
    def column(self) -> str | None:
        """The column whose sensor's offset this is; `None` for anything else."""
        return self.path.removeprefix(OFFSET) if self.path.startswith(OFFSET) else None


def places(actuator: AbstractActuator, ranges: Mapping[str, float]) -> dict[str, Place]:
    """Everything that can be fitted, by every name that it goes by.

    A quantity of the card goes by its name there and by its path, a parameter of an effect by its path
    with or without the leading ``effects.``, an entry of an array by the array's name and its indices, a
    sensor's offset by ``offset.COLUMN``.

    Args:
        ranges: measured column → range of its samples (SI), the natural size of its offset is 1 % of it.
    """
    by_path = {path: name for name, path in actuator.quantities.items()}
    found: dict[str, Place] = {}
    for path, entry in parameters(actuator).items():
        for own in dict.fromkeys((path, *entries_of(path, entry.value))):
            whole = dataclasses.replace(entry, path=own, value=get(actuator, own))
            place = _place(whole, by_path.get(own, own))
            found[own] = found[place.name] = place
            if own.startswith("effects."):
                found.setdefault(own.removeprefix("effects."), place)
    for column in columns(actuator):
        name, unit = OFFSET + column, actuator.column(column).unit
        size = 0.01 * ranges.get(column, 0.0) or None
        meaning = f"what the sensor of {column} shows too much"
        found[name] = Place(name, name, 0.0, unit, meaning, typical=size)
    return found


def columns(actuator: AbstractActuator) -> tuple[str, ...]:
    """Every column that a sensor measures, commands apart."""
    groups = (*actuator.measured.values(), *actuator.outputs.values())
    names = dict.fromkeys(name for group in groups for name in group)
    return tuple(name for name in names if name not in actuator.commands)


def range_of(readings: NDArray[np.float64]) -> float:
    """Of the readings that are numbers; zero without any."""
    known = readings[np.isfinite(readings)]
    return float(np.ptp(known)) if known.size else 0.0


def resolve(known: Mapping[str, Place], name: str, where: str) -> Place:
    """The place that `name` stands for.

    Args:
        known: as :func:`places` gives it.
        where: the argument that the name came in, for the message.

    Raises:
        InputError: there is no such parameter; the message has the nearest name.
    """
    if name in known:
        return known[name]
    raise InputError(f"{where}: unknown parameter {name!r}{nearest(name, known)}")


def expanded(known: Mapping[str, Place], place: Place) -> list[Place]:
    """The place itself, or the places of all entries of an array."""
    if place.shape == ():
        return [place]
    return [known[path] for path in entries_of(place.path, np.empty(place.shape))]


def _place(entry: Parameter, name: str) -> Place:
    shape = jnp.shape(entry.value)
    value = float(entry.value) if shape == () else float("nan")
    how = (entry.positive, entry.nonnegative, entry.typical)
    return Place(name, entry.path, value, entry.unit, entry.meaning, *how, shape)
