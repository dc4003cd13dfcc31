"""Fitting several recordings at once, from many starts, with all that is needed to judge the outcome."""

from jaxmuscle.estimation.fit import fit
from jaxmuscle.estimation.loss import Loss
from jaxmuscle.estimation.losses import Huber, Squares, Student
from jaxmuscle.estimation.result import FitResult

__all__ = ["FitResult", "Huber", "Loss", "Squares", "Student", "fit"]
