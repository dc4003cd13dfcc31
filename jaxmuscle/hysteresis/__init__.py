"""Rate-independent hysteresis: operators, Prandtl-Ishlinskii models, their inverses, Frame's rule."""

from jaxmuscle.hysteresis.base import AbstractHysteresis, respond
from jaxmuscle.hysteresis.classical import (
    ExponentialPrandtlIshlinskii,
    PrandtlIshlinskii,
    exponential_density,
    spaced_thresholds,
)
from jaxmuscle.hysteresis.compensator import IntegralInverse, inverted
from jaxmuscle.hysteresis.frame import FrameRule, midline
from jaxmuscle.hysteresis.inverse import inverse, inverse_memory
from jaxmuscle.hysteresis.modified import (
    Envelope,
    GeneralizedPrandtlIshlinskii,
    ModifiedPrandtlIshlinskii,
)
from jaxmuscle.hysteresis.operators import dahl, enveloped_play, play, stop
from jaxmuscle.hysteresis.published import elbow_classical, elbow_modified

__all__ = [
    "AbstractHysteresis",
    "Envelope",
    "ExponentialPrandtlIshlinskii",
    "FrameRule",
    "GeneralizedPrandtlIshlinskii",
    "IntegralInverse",
    "ModifiedPrandtlIshlinskii",
    "PrandtlIshlinskii",
    "dahl",
    "elbow_classical",
    "elbow_modified",
    "enveloped_play",
    "exponential_density",
    "inverse",
    "inverse_memory",
    "inverted",
    "midline",
    "play",
    "respond",
    "spaced_thresholds",
    "stop",
]
