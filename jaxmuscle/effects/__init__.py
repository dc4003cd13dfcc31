"""The catalogue of effects. A new effect is a class in one of these files and a line in `CATALOGUE` or
`FURTHER`.
"""

from jaxmuscle.effects.base import (
    AbstractEffect,
    AbstractMemoryEffect,
    AbstractRateEffect,
    AbstractStaticEffect,
)
from jaxmuscle.effects.command import CommandDelay, DeadBand, RateLimit, SpoolHysteresis, ValveOffset
from jaxmuscle.effects.creep import Creep, ViscoelasticCreep
from jaxmuscle.effects.force_loss import BoucWen, ForceDrift
from jaxmuscle.effects.friction import (
    LoadFriction,
    Presliding,
    PressureDependentFriction,
    Stribeck,
    ThreadFriction,
)
from jaxmuscle.effects.gas_path import ChamberLeak, DeadVolume, GasHeating, LineLag, SupplyDroop
from jaxmuscle.effects.load import EndStop, Gravity, LoadDamping
from jaxmuscle.effects.muscle import (
    BladderHoopStiffness,
    BladderStiffness,
    LengthHysteresis,
    MuscleMismatch,
    PressureDependentEnds,
    WallThickness,
)
from jaxmuscle.effects.names import effect_named, is_registered, names_on
from jaxmuscle.effects.readings import AbstractReadingEffect, reading_effect, reading_effects
from jaxmuscle.effects.register import BY_NAME, register
from jaxmuscle.effects.sensors import Backlash, ForceSensorLag, ForceSensorNonlinearity, PressureSensorLag
from jaxmuscle.effects.transmission import EccentricSprocket, ElasticTendon
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

EXTENSION: tuple[type[AbstractEffect], ...] = (
    ValveOffset,
    SpoolHysteresis,
    DeadBand,
    RateLimit,
    SupplyDroop,
    LineLag,
    DeadVolume,
    GasHeating,
    WallThickness,
    ForceDrift,
    PressureDependentFriction,
    EndStop,
    PressureSensorLag,
    ForceSensorNonlinearity,
    Backlash,
)
"""Effects that a diagnosis seeks beside those of the catalogue, and with errors of the sensors
(:func:`reading_effects`), where the catalogue leaves something."""

DECLARABLE: tuple[type[AbstractEffect], ...] = (
    Presliding,
    Stribeck,
    EccentricSprocket,
    ElasticTendon,
    BoucWen,
    ViscoelasticCreep,
)
"""Effects that cards may declare and a diagnosis seeks where they are named in its `catalogue`: on many
recordings they imitate others (Coulomb friction, unequal muscles, a bladder's stiffness), or it is not known
whether they do (viscoelastic creep). Presliding is tried without being named too, where the usual effects
leave something and the card declares dry friction."""

ONLY_RIVALS: tuple[type[AbstractEffect], ...] = (EccentricSprocket,)
"""Those of them that a diagnosis tries as rivals of the first effect that it finds. A sprocket beside its
centre moves a joint much as two unlike muscles do: blind joint 100018 was named so, with 3.7 noise units left
that a sprocket does not leave; at a true mismatch (100086) it removes 0.71 of the excess error, too little to
be fitted."""

FURTHER = (*EXTENSION, *DECLARABLE)
"""All effects beside those of the catalogue."""

ALTERNATIVE_FORMS: tuple[type[AbstractEffect], ...] = (FrameValveHysteresis,)
"""Other models of an effect of the catalogue: cards may declare them, a diagnosis does not seek them."""

for _effect in (*CATALOGUE, *FURTHER, *ALTERNATIVE_FORMS):
    register(_effect)

__all__ = [
    "ALTERNATIVE_FORMS",
    "BY_NAME",
    "CATALOGUE",
    "DECLARABLE",
    "EXTENSION",
    "FURTHER",
    "ONLY_RIVALS",
    "AbstractEffect",
    "AbstractMemoryEffect",
    "AbstractRateEffect",
    "AbstractReadingEffect",
    "AbstractStaticEffect",
    "Backlash",
    "BladderHoopStiffness",
    "BladderStiffness",
    "BoucWen",
    "ChamberLeak",
    "CommandDelay",
    "Creep",
    "CurrentSaturation",
    "DeadBand",
    "DeadVolume",
    "EccentricSprocket",
    "ElasticTendon",
    "EndStop",
    "ForceDrift",
    "ForceSensorLag",
    "ForceSensorNonlinearity",
    "FrameValveHysteresis",
    "GasHeating",
    "Gravity",
    "LengthHysteresis",
    "LineLag",
    "LoadDamping",
    "LoadFriction",
    "MuscleMismatch",
    "Presliding",
    "PressureDependentEnds",
    "PressureDependentFriction",
    "PressureSensorLag",
    "RateLimit",
    "SpoolHysteresis",
    "Stribeck",
    "SupplyDroop",
    "ThreadFriction",
    "ValveHysteresis",
    "ValveOffset",
    "ViscoelasticCreep",
    "WallThickness",
    "effect_named",
    "is_registered",
    "names_on",
    "reading_effect",
    "reading_effects",
    "register",
]
