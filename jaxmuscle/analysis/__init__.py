"""Operating points of a machine and its linear behaviour about them."""

from jaxmuscle.analysis.equilibrium import OperatingPoint, equilibrium, equilibrium_at
from jaxmuscle.analysis.linear import LinearModel
from jaxmuscle.analysis.linearise import linearise

__all__ = ["LinearModel", "OperatingPoint", "equilibrium", "equilibrium_at", "linearise"]
