"""Numbers of a fit as plain data: parameters with their uncertainty, correlations, outcomes of the starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.covariance import Covariance
from jaxmuscle.estimation.free_parameters import Unknowns, settled
from jaxmuscle.estimation.identifiability import Undetermined
from jaxmuscle.estimation.intervals import Fitted, Noise, Profile, StartOutcome
from jaxmuscle.estimation.multistart import Found
from jaxmuscle.estimation.nonsmooth import RoughWindow
from jaxmuscle.estimation.residual_analysis import ResidualTest
from jaxmuscle.optimization.descents import FAILED, Lane
from jaxmuscle.parameter_names import ByName, Value, spelled
from jaxmuscle.parameters import Declaration
from jaxmuscle.recordings.card import Card


@dataclasses.dataclass(frozen=True)
class FitData:
    """The numbers of a :class:`~jaxmuscle.estimation.fit.FitResult`.

    Attributes:
        actuator: the fitted machine, in the first recording; `actuators` in each.
        parameters: name → fitted value. These, `values` and `std` are found by every spelling of a name
            (:class:`~jaxmuscle.parameter_names.ByName`); the tables go by the names that are printed.
        correlations: between the parameters, by the rule for coloured residuals (`Fitted.coloured`),
            whichever of the rules gave `std`; those at a bound have none.
        cost: loss of all weighted residuals and priors.
        code: "converged", "stalled" (no step lowers the cost any more), "steps" or "budget" (best so far).
        starts: outcome of every start, in their order.
        undetermined: combinations that the data do not determine; `idle`: parameters without influence.
        tests: whiteness of the residuals and independence of the inputs.
        noise: recording → column → noise.
        predictions: recording → table over time: measured column, ``COLUMN fitted`` (each link with its
            inputs as it was fitted), ``COLUMN std`` (of a reading about it: 95 % lie within 1.96
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

    def __post_init__(self) -> None:
        """Let parameters be found by every name of theirs."""
        object.__setattr__(self, "parameters", self._by_name(self.parameters))

    def _by_name(self, values: Mapping[str, Value]) -> ByName[Value]:
        spellings: dict[str, str] = {}
        for name, fitted in self.parameters.items():
            own = "" if fitted.recording is None else f"[{fitted.recording}]"
            spellings |= spelled({name.removesuffix(own): fitted.path}, own)
        return ByName(values, spellings)

    @property
    def values(self) -> dict[str, float]:
        """Name → fitted value (SI)."""
        return self._by_name({name: fitted.value for name, fitted in self.parameters.items()})

    @property
    def std(self) -> dict[str, float]:
        """Name → standard deviation (SI)."""
        return self._by_name({name: fitted.std for name, fitted in self.parameters.items()})

    @property
    def covariance(self) -> pd.DataFrame:
        """Of the fitted values (SI): `correlations` times `std`, each the largest that a rule gives.

        Of combinations it may say too much or too little where that is another rule than the coloured one.
        """
        std = np.array([self.std[name] for name in self.correlations.index])
        with np.errstate(invalid="ignore"):  # an infinite one has no covariance with others
            return self.correlations * std[:, None] * std[None, :]

    def std_given(self, name: str, held: Sequence[str]) -> float:
        r"""Standard deviation of a parameter were others known to have the values that were fitted (SI).

        :math:`σ \sqrt{1 - r^T R^{-1} r}`, r: its correlations with those that are held, R: theirs
        (Anderson, An Introduction to Multivariate Statistical Analysis, 2003, section 2.5.1). What has no
        correlation, as it is at a bound, counts as held anyway.
        """
        std, table = self.std[name], self.correlations
        others = [other for other in held if other in table.index and other != name]
        if name not in table.index or not others:
            return std
        between = table.loc[[name, *others], [name, *others]].to_numpy(dtype=float)
        known = np.flatnonzero(np.isfinite(between[0]))[1:]
        r, of_others = between[0, known], between[known][:, known]
        explained = float(r @ np.linalg.pinv(of_others, hermitian=True) @ r)
        return std * float(np.sqrt(max(1.0 - explained, 0.0)))

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


ALIKE = 0.5
"""Distance of two costs per mean square residual up to which two starts reached one minimum: of points that
far apart in cost the data cannot tell which is nearer to the truth."""
BESIDE, RUGGED = 1.0, 0.01
"""Standard deviations between two ends in every parameter, and part of their cost, up to which both are
in one minimum too: where dry friction sticks and slips, the cost is rugged by as much."""

DECLARED = tuple(field.name for field in dataclasses.fields(Declaration))


def fitted(
    unknowns: Unknowns,
    u: NDArray[np.float64],
    sure: Covariance,
    ends: NDArray[np.int64],
    to_values: NDArray[np.float64],
    labels: Sequence[str],
) -> dict[str, Fitted]:
    """Each parameter by name.

    Args:
        to_values: slopes of the values by the coordinates.
        labels: of the recordings.
    """
    values = settled(unknowns, u)
    found = {}
    for i, entry in enumerate(unknowns.entries):
        size = abs(float(to_values[i]))
        found[entry.name] = Fitted(
            value=float(values[i]),
            std=size * float(sure.std[i]),
            path=entry.place.path,
            **{name: getattr(entry.place, name) for name in DECLARED},
            start=entry.start,
            lower=entry.lower,
            upper=entry.upper,
            independent=size * float(sure.independent[i]),
            coloured=size * float(sure.coloured[i]),
            windows=size * float(sure.windows[i]),
            states=size * float(sure.states[i]),
            prior=None if entry.prior is None else (entry.prior.mean, entry.prior.std),
            at_bound={-1: "lower", 1: "upper"}.get(int(ends[i])),
            recording=labels[entry.recordings[0]] if entry.name != entry.place.name else None,
        )
    return found


def correlations(sure: Covariance, unknowns: Unknowns, ends: NDArray[np.int64]) -> pd.DataFrame:
    """Correlations of the parameters that are not at a bound."""
    table = pd.DataFrame(sure.correlations, index=unknowns.names, columns=unknowns.names)
    inner = [name for name, end in zip(unknowns.names, ends, strict=True) if not end]
    return table.loc[inner, inner]


def outcomes(found: Found, sure: Covariance) -> tuple[StartOutcome, ...]:
    """Where each start ended, and whether the data can tell that from the best."""
    unknowns = found.objective.unknowns
    scale = max(2 * found.best.cost / max(found.limits.samples, 1), 1e-6)
    named = lambda u: dict(zip(unknowns.names, unknowns.values(u).tolist(), strict=True))  # noqa: E731
    return tuple(
        StartOutcome(
            named(point),
            named(lane.u),
            lane.cost,
            lane.code,
            lane.reason,
            lane.steps,
            lane.code != FAILED and _alike(lane, found.best, scale, sure.std),
        )
        for point, lane in zip(found.points, found.lanes, strict=True)
    )


def _alike(lane: Lane, best: Lane, scale: float, std: NDArray[np.float64]) -> bool:
    beside = bool((np.abs(lane.u - best.u) <= BESIDE * std).all()) and lane.cost <= (1 + RUGGED) * best.cost
    return beside or lane.cost - best.cost <= ALIKE * scale
