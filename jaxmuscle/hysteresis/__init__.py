"""Rate-independent hysteresis: operators, Prandtl-Ishlinskii models, their inverses, Frame's rule."""

from jaxmuscle.hysteresis.compensation import (
    AnalyticInverse,
    IntegralInverse,
    inverse,
    inverse_memory,
    inverted,
)
from jaxmuscle.hysteresis.frame import FrameRule, midline
from jaxmuscle.hysteresis.operators import (
    AbstractHysteresis,
    dahl,
    dahl_between_limits,
    enveloped_play,
    play,
    respond,
    stop,
)
from jaxmuscle.hysteresis.prandtl_ishlinskii import (
    Envelope,
    ExponentialPrandtlIshlinskii,
    GeneralizedPrandtlIshlinskii,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    elbow_classical,
    elbow_modified,
    exponential_density,
    spaced_thresholds,
)

__all__ = [
    "AbstractHysteresis",
    "AnalyticInverse",
    "Envelope",
    "ExponentialPrandtlIshlinskii",
    "FrameRule",
    "GeneralizedPrandtlIshlinskii",
    "IntegralInverse",
    "ModifiedPrandtlIshlinskii",
    "PrandtlIshlinskii",
    "dahl",
    "dahl_between_limits",
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
