"""What a fit says of one parameter, one start, one sensor."""

from __future__ import annotations

import dataclasses
import math

from jaxmuscle.estimation.profile import QUANTILE
from jaxmuscle.parameters import Declaration


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fitted(Declaration):
    """One fitted value (SI) of what is declared.

    Attributes:
        std: the largest of `independent`, `coloured`, `windows` and `states`, see
            :func:`jaxmuscle.estimation.covariance.covariance`; 0 at a bound.
        prior: mean and standard deviation of what was known beforehand.
        at_bound: "lower" or "upper" when the value ended there.
        recording: name of the recording whose own it is, `None` for one of all recordings.
        inner: end of the 95 % interval of a value at a bound; `None` for others.
        conflict: distance between the prior and what the data say without it, in standard deviations of
            their difference; 0 unless they contradict each other.
    """

    value: float
    std: float
    path: str
    start: float
    lower: float
    upper: float
    independent: float
    coloured: float
    windows: float
    prior: tuple[float, float] | None = None
    at_bound: str | None = None
    recording: str | None = None
    states: float = 0.0
    inner: float | None = None
    conflict: float = 0.0

    def interval(self) -> tuple[float, float]:
        """95 % confidence interval; of a positive parameter on the logarithm, and within the bounds.

        A value at a bound is one end of it.
        """
        if self.inner is not None:
            return min(self.value, self.inner), max(self.value, self.inner)
        reach = QUANTILE * self.std
        if self.positive and math.isfinite(reach):
            # A factor beyond e^700 is as good as infinite, and no number.
            factor = math.exp(min(reach / self.value, 700.0))
            low, high = self.value / factor, self.value * factor
        else:
            low, high = self.value - reach, self.value + reach
        return max(low, self.lower), min(high, self.upper)


@dataclasses.dataclass(frozen=True)
class StartOutcome:
    """One start: its values, where it ended, its cost there, and how; `reason` why it failed."""

    start: dict[str, float]
    end: dict[str, float]
    cost: float
    code: str
    reason: str
    steps: int
    reached: bool


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise of one column (SI).

    Attributes:
        assumed: of the sensor.
        residual: root mean square residual.
        ratio: root mean square of the residuals over what was expected of each: the sensor's noise, and
            what the smoothed states that predictions begin from leave uncertain; residuals weighted as the
            loss does, so that outliers hardly count under a robust one; 1 for normal noise under any loss.
    """

    assumed: float
    residual: float
    ratio: float
    autocorrelation_time: float
    unit: str
