"""How a column of a diagnosis is printed and drawn: in the unit and reference of its card."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle import formatting
from jaxmuscle.diagnosis.diagnosis_data import DiagnosisData
from jaxmuscle.units import scale, to_si


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


def shown_column(diagnosis: DiagnosisData, column: str) -> ShownColumn:
    """How a column of the recording is printed: in the unit and reference of its card."""
    card, si = diagnosis.recording.card, diagnosis.units[column]
    spec = card.columns[column]
    shift = to_si(0.0, spec.unit, si, diagnosis.model.column(column).difference)
    shift += card.ambient_pressure if spec.reference == "gauge" else 0.0
    return ShownColumn(column, formatting.pretty(spec.unit), scale(spec.unit, si), shift)
