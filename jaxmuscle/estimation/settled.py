"""What a point of a search stands for: values, those at a bound exactly there, and the machine."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.parameter_names import of_machine
from jaxmuscle.parameters import replace

AT_BOUND = 1e-9
"""Distance from a bound, relative to 1 and to the bound, up to which a value is at it."""


def moved_machine(
    actuator: AbstractActuator, unknowns: Unknowns, u: NDArray[np.float64], number: int
) -> AbstractActuator:
    """The machine in a recording with the values at coordinates u; neither offsets nor initial states are
    part of it.
    """
    values = settled(unknowns, u)
    entries = [(unknowns.entries[i].place.path, float(values[i])) for i in unknowns.acting_on(number)]
    return replace(actuator, {path: value for path, value in entries if of_machine(path)})


def at_bound(unknowns: Unknowns, u: NDArray[np.float64]) -> NDArray[np.int64]:
    """-1 for coordinates at their lower bound, 1 at their upper one, 0 for the others."""

    def near(bound: NDArray[np.float64]) -> Bool[np.ndarray, " k"]:
        finite = np.isfinite(bound)
        safe = np.where(finite, bound, 0.0)
        return finite & (np.abs(u - safe) <= AT_BOUND * (1 + np.abs(safe)))

    return np.where(near(unknowns.lower), -1, np.where(near(unknowns.upper), 1, 0))


def settled(unknowns: Unknowns, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (SI) at coordinates u; those at a bound are the bound, to the last bit."""
    ends = at_bound(unknowns, u)
    lower = np.array([entry.lower for entry in unknowns.entries])
    upper = np.array([entry.upper for entry in unknowns.entries])
    return np.where(ends < 0, lower, np.where(ends > 0, upper, unknowns.values(u)))
