"""Everything that a fit can move, by every name that it goes by, and the sensors of a rig."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.parameter_names import OFFSET, known_names
from jaxmuscle.parameters import Parameter


def fittable(actuator: AbstractActuator, ranges: Mapping[str, float]) -> dict[str, Parameter]:
    """The parameters of a machine and the offsets of its sensors by name; the value of an offset is 0.

    Args:
        ranges: measured column → range of its samples (SI); the natural size of its offset is 1 % of it.
    """
    found = known_names(actuator)
    for column in columns(actuator):
        found[OFFSET + column] = Parameter(
            path=OFFSET + column,
            value=0.0,
            unit=actuator.column(column).unit,
            meaning=f"what the sensor of {column} shows too much",
            typical=0.01 * ranges.get(column, 0.0) or None,
        )
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
