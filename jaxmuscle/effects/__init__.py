"""The catalogue of effects. A new effect is a class in one of these files and a line in `CATALOGUE`."""

from jaxmuscle.effects.base import (
    BY_NAME,
    AbstractEffect,
    AbstractMemoryEffect,
    AbstractRateEffect,
    AbstractStaticEffect,
    is_registered,
    register,
)
from jaxmuscle.effects.friction import LoadFriction, ThreadFriction
from jaxmuscle.effects.load import ForceSensorLag, Gravity, LoadDamping
from jaxmuscle.effects.muscle import (
    BladderHoopStiffness,
    BladderStiffness,
    Creep,
    LengthHysteresis,
    MuscleMismatch,
    PressureDependentEnds,
)
from jaxmuscle.effects.valve import (
    ChamberLeak,
    CommandDelay,
    CurrentSaturation,
    FrameValveHysteresis,
    ValveHysteresis,
)

CATALOGUE: tuple[type[AbstractEffect], ...] = (
    CommandDelay,
    CurrentSaturation,
    ValveHysteresis,
    ChamberLeak,
    ThreadFriction,
    LengthHysteresis,
    Creep,
    BladderStiffness,
    BladderHoopStiffness,
    PressureDependentEnds,
    MuscleMismatch,
    LoadFriction,
    LoadDamping,
    Gravity,
    ForceSensorLag,
)

ALTERNATIVE_FORMS: tuple[type[AbstractEffect], ...] = (FrameValveHysteresis,)
"""Other models of an effect of the catalogue: cards may declare them, a diagnosis does not seek them."""

for _effect in (*CATALOGUE, *ALTERNATIVE_FORMS):
    register(_effect)

__all__ = [
    "ALTERNATIVE_FORMS",
    "BY_NAME",
    "CATALOGUE",
    "AbstractEffect",
    "AbstractMemoryEffect",
    "AbstractRateEffect",
    "AbstractStaticEffect",
    "BladderHoopStiffness",
    "BladderStiffness",
    "ChamberLeak",
    "CommandDelay",
    "Creep",
    "CurrentSaturation",
    "ForceSensorLag",
    "FrameValveHysteresis",
    "Gravity",
    "LengthHysteresis",
    "LoadDamping",
    "LoadFriction",
    "MuscleMismatch",
    "PressureDependentEnds",
    "ThreadFriction",
    "ValveHysteresis",
    "is_registered",
    "register",
]
