"""A fitted model with what it leaves, which counts as uncertainty beside the noise of the sensors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.losses import SQUARES, Loss
from jaxmuscle.estimation.serialization import plain, restored
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import CONVERGED, STALLED
from jaxmuscle.parameters import parameters, replace

SETTLED = (CONVERGED, STALLED)
"""How a fit ends that more steps would not carry on."""

LEAST_WEIGHT = 0.1
"""Factor of a weight below which fits begin with weights by the sensors' noise, too. An error that lasts as
long as the recording hides what would remove it: of a backlash of 0.319 mm in a lift's position (factor 0.01)
no gap had hope; so 0.318 mm are found, which leave 1.9 noise units of 6.9 on unseen data (122125 of
`blind_recordings.drawn`)."""

Factors = Mapping[str, Float[np.ndarray, " columns"]]
"""Output → what the weights of its columns are multiplied by, as what a model leaves is uncertainty."""


def weight_factors(left: Mapping[str, Sequence[Discrepancy]]) -> Factors:
    """What the weights are multiplied by where a model leaves so much of each output."""
    return {output: np.array([each.factor for each in columns]) for output, columns in left.items()}


def cost_of_noise(factors: Factors, problem: Problem, loss: Loss) -> float:
    """Cost that the sensors' noise leaves where weights are multiplied by `factors`."""
    counts = {out: int((np.asarray(w) > 0).sum()) for out, w in problem.weights.items()}
    return sum(float(loss.cost_of_noise(each).mean()) * counts[out] for out, each in factors.items())


@dataclasses.dataclass(frozen=True)
class SettledFit:
    """A fitted model.

    Attributes:
        cost, code: cost at the end of its last descent, and how that ended.
        left: output → what it leaves, column by column.
        far: half the sum of its squared distances from the priors.
        hopeful: whether it was fitted to the end.
    """

    model: AbstractActuator
    cost: float
    code: str
    left: Mapping[str, Sequence[Discrepancy]]
    far: float
    hopeful: bool = True

    @property
    def converged(self) -> bool:
        """Whether more steps would not carry it on."""
        return self.code in SETTLED

    @property
    def factors(self) -> Factors:
        """What the weights are multiplied by, as what it leaves is uncertainty."""
        return weight_factors(self.left)

    @property
    def weighs_little(self) -> bool:
        """Whether what it leaves of a column weighs so little that it may hide what is missing there."""
        return min(float(each.min()) for each in self.factors.values()) < LEAST_WEIGHT

    @property
    def independent_readings(self) -> float:
        """Readings that what it leaves is worth, of the column where they are fewest."""
        return min(each.readings / each.time for columns in self.left.values() for each in columns)

    def noise_in_residuals(self, problem: Problem) -> float:
        """Root mean square residual that the sensors' noise leaves by these weights."""
        readings = sum(int((np.asarray(w) > 0).sum()) for w in problem.weights.values())
        return math.sqrt(2 * cost_of_noise(self.factors, problem, SQUARES) / max(readings, 1))


def best_of(fits: Sequence[SettledFit]) -> int:
    """Which of several fits leaves least, by the cost of what is left and of the distances from the priors.

    Readings count for all of them as by the longest correlation time of any: by its own, a large error that
    lasts would cost less than a small one that does not.
    """
    times = {
        (output, i): max(fit.left[output][i].time for fit in fits)
        for output, columns in fits[0].left.items()
        for i in range(len(columns))
    }

    def cost(fit: SettledFit) -> float:
        each = (dataclasses.replace(fit.left[o][i], time=time).cost for (o, i), time in times.items())
        return sum(each) + fit.far

    return min(range(len(fits)), key=lambda i: cost(fits[i]))


def as_record(fit: SettledFit, base: AbstractActuator) -> Any:
    """A fit as plain data: of its model what differs from `base`, a model of the same structure."""
    before = {path: np.asarray(entry.value) for path, entry in parameters(base).items()}
    after = {path: np.asarray(entry.value) for path, entry in parameters(fit.model).items()}
    if before.keys() != after.keys():
        raise ValueError(f"expected a model of the same structure; {before.keys() ^ after.keys()} differ")
    values = {path: new for path, new in after.items() if new.tobytes() != before[path].tobytes()}
    return plain({**{f.name: getattr(fit, f.name) for f in dataclasses.fields(fit)}, "model": values})


def from_record(record: Any, base: AbstractActuator) -> SettledFit:
    """The inverse of :func:`as_record`."""
    data = restored(record)
    left = {output: [Discrepancy(**each) for each in columns] for output, columns in data["left"].items()}
    model = replace(base, data["model"]) if data["model"] else base
    return SettledFit(**{**data, "model": model, "left": left})
