"""The elbow of [W]: parameters as identified there (Wang et al. 2019, Tables 1 and 2)."""

from __future__ import annotations

from typing import Any

from jaxmuscle.hysteresis.classical import ExponentialPrandtlIshlinskii
from jaxmuscle.hysteresis.modified import Envelope, ModifiedPrandtlIshlinskii

PUBLISHED_ERRORS = {"classical": 0.2267, "modified": 0.0465}
"""Largest errors relative to the range of the angle on the measured loops of [W], text after Table 2."""
UNSTATED_SPACING = 0.25
"""Distance of the thresholds of the classical model: Table 1 gives none, so that of Table 2 stands in."""


def elbow_classical(operators: int = 10) -> ExponentialPrandtlIshlinskii:
    """Classical model of the elbow, [W] Table 1. Angle in degrees; the unit of the input is not stated.

    Neither the number of operators nor the spacing is: the latter is that of Table 2 here.
    """
    kind: Any = ExponentialPrandtlIshlinskii  # its converters make arrays of the numbers
    return kind(-8.223, 12.407, 6.529, UNSTATED_SPACING, operators=operators)


def elbow_modified(operators: int = 10) -> ModifiedPrandtlIshlinskii:
    """Modified model of the elbow, [W] Table 2. Angle in degrees; the unit of the input is not stated.

    α, p1 and p2 are assigned as the order of a broken table suggests. Read as written, no unit of the input
    gives the 0 to 90 degrees of [W] over 0 to 0.6 MPa: the numbers test the equations, they are no elbow.
    """
    envelope: Any = Envelope
    kind: Any = ModifiedPrandtlIshlinskii
    rising = envelope(7.313, 0.381, -0.085, -2.050)
    falling = envelope(1.790, 0.816, -1.588, -0.696)
    return kind(rising, falling, 17.371, 2.092, 0.250, 0.777, -0.819, operators)
