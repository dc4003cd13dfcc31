"""What a tuning tells of each gain, and of what gains do on some scenarios."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd

LARGEST = ("peak", "overshoot", "settling", "sensitivity")
"""Terms of which several scenarios have the largest value; of the others the root mean square."""


@dataclasses.dataclass(frozen=True)
class Gain:
    """A tuned gain.

    Attributes:
        value, start: after and before (SI).
        unit, meaning: as the controller declares it.
        lower, upper: bounds (SI).
        at_bound: "lower" or "upper" where it ended at one.
        less, more: relative rise of the cost on the training scenarios with 10 % less and 10 % more of it,
            measured; NaN for one of very many.
    """

    value: float
    start: float
    unit: str
    meaning: str
    lower: float
    upper: float
    at_bound: str
    less: float
    more: float


@dataclasses.dataclass(frozen=True)
class Judged:
    """What gains do on some scenarios.

    Attributes:
        cost: of all of them together.
        terms: a row for each scenario: its cost, and the value of every term (SI).
    """

    cost: float
    terms: pd.DataFrame

    def value(self, term: str) -> float:
        """Of a term over all scenarios: the largest of peaks, overshoots and times, of others the root mean
        square.
        """
        values = self.terms[term].to_numpy(dtype=float)
        return float(values.max() if term in LARGEST else np.sqrt(np.mean(values**2)))
