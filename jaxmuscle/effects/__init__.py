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
from jaxmuscle.effects.command import CommandDelay, DeadBand, RateLimit, SpoolHysteresis, ValveOffset
from jaxmuscle.effects.friction import LoadFriction, ThreadFriction
from jaxmuscle.effects.gas import ChamberLeak, DeadVolume, GasHeating, LineLag, SupplyDroop
from jaxmuscle.effects.load import ForceSensorLag, Gravity, LoadDamping
from jaxmuscle.effects.muscle import (
    BladderHoopStiffness,
    BladderStiffness,
    Creep,
    LengthHysteresis,
    MuscleMismatch,
    PressureDependentEnds,
)
from jaxmuscle.effects.valve import CurrentSaturation, FrameValveHysteresis, ValveHysteresis

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

FURTHER: tuple[type[AbstractEffect], ...] = (
    ValveOffset,
    SpoolHysteresis,
    DeadBand,
    RateLimit,
    SupplyDroop,
    LineLag,
    DeadVolume,
    GasHeating,
)
"""Declared by cards or named in ``catalogue=``; a diagnosis does not seek them by itself."""

ALTERNATIVE_FORMS: tuple[type[AbstractEffect], ...] = (FrameValveHysteresis,)
"""Other models of an effect of the catalogue: cards may declare them, a diagnosis does not seek them."""

for _effect in (*CATALOGUE, *FURTHER, *ALTERNATIVE_FORMS):
    register(_effect)

__all__ = [
    "ALTERNATIVE_FORMS",
    "BY_NAME",
    "CATALOGUE",
    "FURTHER",
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
    "DeadBand",
    "DeadVolume",
    "ForceSensorLag",
    "FrameValveHysteresis",
    "GasHeating",
    "Gravity",
    "LengthHysteresis",
    "LineLag",
    "LoadDamping",
    "LoadFriction",
    "MuscleMismatch",
    "PressureDependentEnds",
    "RateLimit",
    "SpoolHysteresis",
    "SupplyDroop",
    "ThreadFriction",
    "ValveHysteresis",
    "ValveOffset",
    "is_registered",
    "register",
]
