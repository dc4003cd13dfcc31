"""Columns and parameters in the units of the experimenter's card."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from jaxmuscle import formatting
from jaxmuscle.diagnosis.result import Diagnosis, Estimate
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.quantity import Quantity
from jaxmuscle.recordings.units import from_si, scale, to_si


@dataclasses.dataclass(frozen=True)
class ShownColumn:
    """How a column is printed and drawn: (SI - shift) / size is a number in `unit`."""

    name: str
    unit: str
    size: float
    shift: float

    def values(self, si: NDArray[np.float64]) -> NDArray[np.float64]:
        """Samples in the column's unit."""
        return (si - self.shift) / self.size

    def error(self, si: float) -> str:
        """An error or a deviation with its unit."""
        return formatting.join(formatting.rounded(si / self.size), self.unit)


def shown_column(diagnosis: Diagnosis, column: str) -> ShownColumn:
    """How a column of the recording is printed: in the unit and reference of its card."""
    card, si = diagnosis.recording.card, diagnosis.units[column]
    spec = card.columns[column]
    shift = to_si(0.0, spec.unit, si, diagnosis.model.column(column).difference)
    shift += card.ambient_pressure if spec.reference == "gauge" else 0.0
    return ShownColumn(column, formatting.pretty(spec.unit), scale(spec.unit, si), shift)


def shown_estimate(card: Card, name: str, estimate: Estimate) -> str:
    """A fitted parameter in the unit in which the card gives it, or in one of the right size."""
    entry = card.entries.get(name)
    if entry is None or not entry.unit:
        return formatting.estimate(estimate.value, estimate.std, estimate.unit)
    value, name_of_unit = _in_card_unit(card, entry, estimate.value, estimate.unit)
    std = estimate.std / scale(entry.unit, estimate.unit)
    return formatting.join(formatting.uncertain(value, std), name_of_unit)


def shown_prior(card: Card, name: str, unit: str) -> str:
    """What the card gives for a parameter, with its standard deviation when it has one; "" without."""
    entry = card.entries.get(name)
    return "" if entry is None else shown_estimate(card, name, prior(entry, unit))


def prior(entry: Quantity, unit: str) -> Estimate:
    """The card's value and deviation (NaN without one) as an estimate."""
    return Estimate(entry.value, math.nan if entry.std is None else entry.std, unit, "")


def _in_card_unit(card: Card, entry: Quantity, value: float, si: str) -> tuple[float, str]:
    shift = card.ambient_pressure if entry.reference == "gauge" else 0.0
    return from_si(value - shift, entry.unit, si), formatting.pretty(entry.unit)
