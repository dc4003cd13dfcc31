"""Constants of a card that may be wrong: candidates beside effects, one parameter each.

A scale, a protractor or a pressure gauge that was misread is no effect: the machine is another one than the
card says. Such a value is freed from what the card says of it, within a range of real machines, and has to
stand the same tests as an effect.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import jax.numpy as jnp

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.case import Case
from jaxmuscle.parameter_names import CONSTANT
from jaxmuscle.parameters import Parameter, parameters
from jaxmuscle.units import RANGES

LAWS = ("ambient_pressure", "gas_temperature", "polytropic_exponent")
"""Quantities that nobody reads off the machine: what is wrong with them is weather, or the gas."""
FACTOR = 10.0
"""How many times larger or smaller a constant without a known range may be than the card says."""


@dataclasses.dataclass(frozen=True)
class CardConstant:
    """A quantity of the card whose value may be wrong, known or uncertain.

    Attributes:
        quantity: its name on the card; `path`: where it is in the machine.
        declared: the card's value; `std`: the card's standard deviation, `None` of one that is known (SI).
        lower, upper: range of real machines (SI).
        meaning: in the words of the field.
    """

    signal: ClassVar = "card"
    column: ClassVar = None
    source: ClassVar = "the card"

    quantity: str
    path: str
    declared: float
    std: float | None
    lower: float
    upper: float
    meaning: str

    @property
    def name(self) -> str:
        """The name that results use."""
        return CONSTANT + self.quantity

    @property
    def kind(self) -> str:
        """The name that results use."""
        return self.name

    def within(self, value: float) -> float:
        """The nearest value within the range."""
        return min(max(value, self.lower), self.upper)


def card_constants(case: Case) -> list[CardConstant]:
    """The constants of a card that may be wrong: numbers that it gives, whose range is known or positive.

    One that differs between joined recordings is as far off in all of them, and in all of them within range.
    """
    actuator, entries = case.actuator, parameters(case.actuator)
    found = []
    for name, quantity in case.recording.card.quantities.items():
        entry = entries[actuator.quantities[name]]
        ends = _range(name, entry, quantity.value)
        if ends is not None and name in case.recording.differences:
            by = case.recording.differences[name]
            ends = ends[0] - min(0.0, float(by.min())), ends[1] - max(0.0, float(by.max()))
        if name in LAWS or jnp.ndim(entry.value) or ends is None or not ends[0] <= quantity.value <= ends[1]:
            continue
        found.append(CardConstant(name, entry.path, quantity.value, quantity.std, *ends, entry.meaning))
    return found


def _range(name: str, entry: Parameter, value: float) -> tuple[float, float] | None:
    """Least and largest value of any machine; `None` where nothing is known of it."""
    kind, *ends = RANGES.get(name, (None, 0.0, 0.0))
    if kind == entry.unit:
        return ends[0], ends[1]
    return (value / FACTOR, value * FACTOR) if entry.positive and value > 0 else None


def constant_path(actuator: AbstractActuator, name: str) -> str | None:
    """Path of the constant that results call `name`; `None` of an effect."""
    return actuator.quantities[name.removeprefix(CONSTANT)] if name.startswith(CONSTANT) else None
