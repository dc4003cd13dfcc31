"""The catalogue of effects. A new effect is a class in one of these files and a line in `CATALOGUE`."""

from jaxmuscle.effects.base import (
    BY_NAME,
    AbstractEffect,
    AbstractMemoryEffect,
    AbstractRateEffect,
    AbstractStaticEffect,
    register,
)
from jaxmuscle.effects.friction import LoadFriction, ThreadFriction
from jaxmuscle.effects.load import Gravity, LoadDamping
from jaxmuscle.effects.muscle import (
    BladderHoopStiffness,
    BladderStiffness,
    Creep,
    LengthHysteresis,
    MuscleMismatch,
    PressureDependentEnds,
)
from jaxmuscle.effects.names import effect_named, is_registered, names_on
from jaxmuscle.effects.readings import AbstractReadingEffect, reading_effect, reading_effects
from jaxmuscle.effects.sensors import Backlash, ForceSensorLag, ForceSensorNonlinearity, PressureSensorLag
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

FURTHER: tuple[type[AbstractEffect], ...] = (
    PressureSensorLag,
    ForceSensorNonlinearity,
    Backlash,
)
"""Further effects: declared by cards or named in ``catalogue=``; a diagnosis does not seek them by itself."""

for _effect in (*CATALOGUE, *ALTERNATIVE_FORMS, *FURTHER):
    register(_effect)

__all__ = [
    "ALTERNATIVE_FORMS",
    "BY_NAME",
    "CATALOGUE",
    "FURTHER",
    "AbstractEffect",
    "AbstractMemoryEffect",
    "AbstractRateEffect",
    "AbstractReadingEffect",
    "AbstractStaticEffect",
    "Backlash",
    "BladderHoopStiffness",
    "BladderStiffness",
    "ChamberLeak",
    "CommandDelay",
    "Creep",
    "CurrentSaturation",
    "ForceSensorLag",
    "ForceSensorNonlinearity",
    "FrameValveHysteresis",
    "Gravity",
    "LengthHysteresis",
    "LoadDamping",
    "LoadFriction",
    "MuscleMismatch",
    "PressureDependentEnds",
    "PressureSensorLag",
    "ThreadFriction",
    "ValveHysteresis",
    "effect_named",
    "is_registered",
    "names_on",
    "reading_effect",
    "reading_effects",
    "register",
]
