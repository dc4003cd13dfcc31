"""Sweeps over operating points: of parameters and of commands, on one machine or on many."""

from jaxmuscle.sweeps.reductions import CATALOGUE, Reduction
from jaxmuscle.sweeps.scenario import Trajectory
from jaxmuscle.sweeps.sweep import FailedPoints, sweep

__all__ = ["CATALOGUE", "FailedPoints", "Reduction", "Trajectory", "sweep"]
