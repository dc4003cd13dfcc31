"""A linear model with white noise, of which all that a fit says can be written down."""

import numpy as np

from jaxmuscle.estimation.free_parameters import Unknown, Unknowns
from jaxmuscle.estimation.intervals import Fitted
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.parameters import Parameter

ROWS = 400
TIME = np.arange(ROWS) / ROWS
SLOPES = np.stack([np.ones(ROWS), TIME])
"""Derivatives of the residuals by a level and a trend, which go together."""
STD = np.sqrt(np.diag(np.linalg.inv(SLOPES @ SLOPES.T)))
"""What the data know of them."""


def unknowns(prior=None, lower=-np.inf, upper=np.inf):
    """The level, with a prior and bounds, and the trend."""
    places = [Parameter(path=name, value=0.0) for name in ("level", "trend")]
    level = Unknown("level", places[0], (0,), 0.0, lower, upper, 1.0, prior)
    return Unknowns([level, Unknown("trend", places[1], (0,), 0.0, -np.inf, np.inf, 1.0)])


def line(u, readings):
    """Residuals at coordinates u, in ten windows."""
    every, window = np.ones(ROWS, bool), np.arange(ROWS) // (ROWS // 10)
    return Series(0, "y", "y", every, u @ SLOPES - readings, SLOPES, window)


def parameters(u, **level):
    """Values without standard deviations."""
    plain = {"unit": "", "meaning": "", "positive": False, "start": 0.0, "lower": -np.inf, "upper": np.inf}
    plain |= {"std": 0.0, "independent": 0.0, "coloured": 0.0, "windows": 0.0}
    known = {"level": plain | level, "trend": plain}
    return {name: Fitted(value=x, path=name, **known[name]) for name, x in zip(known, u, strict=True)}
