"""A recording beside its card, as the checks of the machine look at it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.actuators.variables import Check
from jaxmuscle.errors import Problems
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.ranges import RANGES, meant
from jaxmuscle.recordings.units import Series, from_si

Fits = Callable[[float], bool]


@dataclasses.dataclass(frozen=True)
class Bench:
    """A card, samples in SI (pressures absolute), and where to note what is wrong with them.

    `row`: how the user calls the sample at an index.
    """

    rig: type[AbstractActuator]
    card: Card
    columns: Mapping[str, Series]
    step: float
    problems: Problems
    row: Callable[[int], str]

    def checked(self, check: Check) -> tuple[str, ...]:
        """The columns that the rig declares to be held to a check."""
        return tuple(name for name, column in self.rig.columns.items() if column.check == check)

    def value(self, name: str) -> float | None:
        """A quantity of the card in SI; `None` when it has none of that name."""
        given = self.card.quantities.get(name)
        return None if given is None else given.value

    def gauge(self, name: str) -> Series:
        """A column of pressures against the ambient one [Pa]."""
        return self.columns[name] - self.card.ambient_pressure

    def most(self, name: str) -> float:
        """The largest value of a column; of a pressure against the ambient one."""
        referenced = self.rig.column(name).referenced
        return float(np.nanmax(self.gauge(name) if referenced else self.columns[name]))

    def column(self, name: str) -> str:
        """How a message calls a column."""
        return f"column {self.card.columns[name].column!r} ({name})"

    def shown(self, name: str, value: float) -> str:
        """A value (SI; pressures gauge) in the unit of a column."""
        unit = self.card.columns[name].unit
        return f"{from_si(value, unit, self._si(name)):.4g} {unit}"

    def units_of_column(self, name: str, value: float, fits: Fits) -> str:
        """In which units a column with this value (SI; pressures gauge) would fit, for a message; or ""."""
        unit, si = self.card.columns[name].unit, self._si(name)
        likely = meant(from_si(value, unit, si), unit, si, fits)
        return likely and f"{likely} in {self.column(name)}"

    def units_of_quantity(self, name: str, fits: Fits) -> str:
        """The same for a quantity of the card, which is to stay within its range (pressures absolute)."""
        given, si = self.card.quantities.get(name), schema.quantities(self.rig)[name].unit
        if given is None:
            return ""
        shift = self.card.ambient_pressure if given.reference == "gauge" else 0.0
        _, low, high = RANGES.get(name, ("", -np.inf, np.inf))
        sound = lambda x: low <= x + shift <= high and fits(x + shift)  # noqa: E731
        likely = meant(from_si(given.value - shift, given.unit, si), given.unit, si, sound)
        return likely and f"{likely} of {name} in the card"

    def add(self, name: str, message: str, *likely: str) -> None:
        """Note what is wrong with a column, and the likely causes (those that are not "")."""
        causes = [cause for cause in likely if cause]
        self.problems.add(self.column(name), message + (f"; is it {', or '.join(causes)}?" if causes else ""))

    def _si(self, name: str) -> str:
        return schema.columns(self.rig)[name].unit
