"""Tuning of controllers by gradient descent through the whole closed loop, over scenarios."""

from jaxmuscle.tuning.judged import Gain, Judged
from jaxmuscle.tuning.objective import TERMS
from jaxmuscle.tuning.result import Tuning
from jaxmuscle.tuning.scenarios import Scenario, drawn, grid, sample
from jaxmuscle.tuning.tune import tune

__all__ = ["TERMS", "Gain", "Judged", "Scenario", "Tuning", "drawn", "grid", "sample", "tune"]
