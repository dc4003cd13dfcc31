"""Estimation of parameters from one or several recordings, from many starts, with all that is needed to
judge the outcome.
"""

from jaxmuscle.estimation.fit import FitResult, fit
from jaxmuscle.estimation.losses import Huber, Loss, Squares, Student

__all__ = ["FitResult", "Huber", "Loss", "Squares", "Student", "fit"]
