"""What is known of a parameter before the data."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Prior:
    """A normal distribution, of a positive parameter on its logarithm: mean and standard deviation, SI."""

    mean: float
    std: float
