"""Analysis of an actuator: operating points, and its linear behaviour about them."""

from jaxmuscle.analysis.linear_model import LinearModel, linearise
from jaxmuscle.analysis.operating_point import OperatingPoint, equilibrium, equilibrium_at

__all__ = ["LinearModel", "OperatingPoint", "equilibrium", "equilibrium_at", "linearise"]
