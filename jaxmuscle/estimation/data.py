"""All that a fit says, as plain data."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.fitted import Fitted, Noise, StartOutcome
from jaxmuscle.estimation.identifiability import Undetermined
from jaxmuscle.estimation.profile import Profile
from jaxmuscle.estimation.rough import RoughWindow
from jaxmuscle.estimation.whiteness import ResidualTest
from jaxmuscle.recordings.card import Card


@dataclasses.dataclass(frozen=True)
class FitData:
    """The numbers of a :class:`~jaxmuscle.estimation.result.FitResult`.

    Attributes:
        actuator: the fitted machine, in the first recording; `actuators` in each.
        parameters: name → fitted value.
        correlations: between the parameters, by the rule for coloured residuals (`Fitted.coloured`),
            whichever of the rules gave `std`; those at a bound have none.
        cost: loss of all weighted residuals and priors.
        code: "converged", "stalled" (no step lowers the cost any more), "steps" or "budget" (best so far).
        starts: outcome of every start, in their order.
        undetermined: combinations that the data do not determine; `idle`: parameters without influence.
        tests: whiteness of the residuals and independence of the inputs.
        noise: recording → column → noise.
        predictions: recording → table over time: measured column, ``COLUMN fitted`` (each link with its
            measured inputs, as it was fitted), ``COLUMN std`` (of a reading about it: 95 % lie within 1.96
            of them) and ``COLUMN predicted`` (from the command alone, window by window); NaN where nothing
            counts or is predicted.
        cards: recording → its card.
        rough: windows that are left out of what is known of a parameter, their derivatives being none.
        settings: the arguments with which the fit can be done again.
    """

    actuator: AbstractActuator
    actuators: tuple[AbstractActuator, ...]
    parameters: dict[str, Fitted]
    correlations: pd.DataFrame
    cost: float
    samples: int
    code: str
    starts: tuple[StartOutcome, ...]
    profiles: tuple[Profile, ...]
    undetermined: tuple[Undetermined, ...]
    idle: tuple[str, ...]
    tests: tuple[ResidualTest, ...]
    noise: dict[str, dict[str, Noise]]
    predictions: dict[str, pd.DataFrame]
    cards: dict[str, Card]
    settings: dict[str, Any]
    iterations: int
    seconds: float
    rough: tuple[RoughWindow, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Name → fitted value (SI)."""
        return {name: fitted.value for name, fitted in self.parameters.items()}

    @property
    def std(self) -> dict[str, float]:
        """Name → standard deviation (SI)."""
        return {name: fitted.std for name, fitted in self.parameters.items()}

    @property
    def covariance(self) -> pd.DataFrame:
        """Of the fitted values (SI): `correlations` times `std`, each the largest that a rule gives.

        Of combinations it may say too much or too little where that is another rule than the coloured one.
        """
        std = np.array([self.std[name] for name in self.correlations.index])
        with np.errstate(invalid="ignore"):  # an infinite one has no covariance with others
            return self.correlations * std[:, None] * std[None, :]

    @property
    def converged(self) -> bool:
        """Whether a minimum was reached."""
        return self.code == "converged"

    @property
    def failed(self) -> dict[str, int]:
        """Reason → number of starts that failed for it."""
        reasons = [start.reason for start in self.starts if start.code == "failed"]
        return {reason: reasons.count(reason) for reason in dict.fromkeys(reasons)}

    def table(self) -> pd.DataFrame:
        """Name, value, std, 95 % interval, unit, prior and remark of every parameter."""
        rows = []
        for name, fitted in self.parameters.items():
            low, high = fitted.interval()
            remark = f"at its {fitted.at_bound} bound" if fitted.at_bound else ""
            remark = "no influence on the data" if name in self.idle else remark
            rows.append((name, fitted.value, fitted.std, low, high, fitted.unit, fitted.prior, remark))
        heads = ["name", "value", "std", "low", "high", "unit", "prior", "remark"]
        return pd.DataFrame(rows, columns=heads).set_index("name")
