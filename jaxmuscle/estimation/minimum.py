"""What is known at the point where a search ended, as those take it who judge the point."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmuscle.estimation.covariance import Covariance, covariance
from jaxmuscle.estimation.loss import Loss
from jaxmuscle.estimation.series import Series
from jaxmuscle.estimation.unknowns import Unknowns


@dataclasses.dataclass(frozen=True)
class Minimum:
    """A point, the residuals there and their derivatives.

    Attributes:
        u: coordinates of the unknowns.
        ends: -1 for those at a lower bound, 1 at an upper one, else 0.
        scores: changes of the score by uncertain states (`begun.state_scores`); `None` for none.
    """

    u: Float[np.ndarray, " k"]
    lines: Sequence[Series]
    unknowns: Unknowns
    loss: Loss
    ends: Int[np.ndarray, " k"]
    scores: Float[np.ndarray, "sources k"] | None = None

    @property
    def held(self) -> Bool[np.ndarray, " k"]:
        """Coordinates at a bound."""
        return self.ends != 0

    def covariance(self, held: Bool[np.ndarray, " k"] | None = None) -> Covariance:
        """How sure the coordinates are, with those known that are `held`: at a bound when `None`."""
        fixed = self.held if held is None else held
        return covariance(self.lines, self.unknowns, self.loss, fixed, self.scores)
