"""What a McKibben muscle can do at all: how far its braid lets it go, and how hard it pulls."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.units import Series

NAMES = ("initial_length", "initial_radius", "braid_angle", "end_factor")
BEYOND = 1.25
"""Contraction that is measured at most, relative to the largest by [T]: its sizes are not known better."""
OFFSET = 0.02
"""Offset of a position sensor at most, relative to the muscle's length."""


@dataclasses.dataclass(frozen=True)
class MuscleLimits:
    """The muscle of a card [m, m, rad, -]; equations as :class:`jaxmuscle.components.McKibben`, in NumPy."""

    initial_length: float
    initial_radius: float
    braid_angle: float
    end_factor: float

    @classmethod
    def of(cls, card: Card) -> MuscleLimits | None:
        """The muscle that a card describes; `None` if it describes none."""
        given = card.quantities
        return cls(*(given[name].value for name in NAMES)) if all(name in given for name in NAMES) else None

    @property
    def largest_contraction(self) -> float:
        r"""Contraction without force, [T] 8, and a quarter of it [m]: :math:`l_0 ε_{max}/\min(k, 1)`,
        :math:`ε_{max} = 1 - 1/(\sqrt3 \cosα_0)`.
        """
        ratio = 1 - 1 / (np.sqrt(3) * np.cos(self.braid_angle))
        return BEYOND * self.initial_length * float(ratio) / min(self.end_factor, 1.0)

    @property
    def largest_extension(self) -> float:
        r"""Extension at which the threads are straight, :math:`l_0 (1/\cosα_0 - 1)`, and an offset [m]."""
        return self.initial_length * float(1 / np.cos(self.braid_angle) - 1 + OFFSET)

    @property
    def offset(self) -> float:
        """Largest offset of a sensor of its contraction [m]."""
        return OFFSET * self.initial_length

    def force(self, contraction: Series | float, gauge_pressure: Series | float) -> Series | float:
        """Static force [N], [T] equations 4, 5 and 7."""
        a, b = 3 / np.tan(self.braid_angle) ** 2, 1 / np.sin(self.braid_angle) ** 2
        shortened = 1 - self.end_factor * contraction / self.initial_length
        return np.pi * self.initial_radius**2 * gauge_pressure * (a * shortened**2 - b)

    def carrying_contraction(self, weight: float, gauge_pressure: float) -> float:
        """Contraction at which a weight [N] hangs [m], [T] 4 and 7 solved for ε; 0 where it stays down."""
        if gauge_pressure <= 0:
            return 0.0
        a, b = 3 / np.tan(self.braid_angle) ** 2, 1 / np.sin(self.braid_angle) ** 2
        carried = weight / (np.pi * self.initial_radius**2 * gauge_pressure)
        return max(0.0, self.initial_length * float(1 - np.sqrt((carried + b) / a)) / self.end_factor)
