"""Differentiable simulation of pneumatic-muscle actuators, and the diagnosis of what a model lacks.

The public names are loaded when they are first used, so that the command line answers before JAX is there.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from jaxmuscle._config import prepare

if TYPE_CHECKING:
    from jaxmuscle import (
        actuators,
        analysis,
        animation,
        components,
        control,
        effects,
        estimation,
        hysteresis,
        parameters,
        recordings,
        robot,
        signals,
        simulation,
        tuning,
    )
    from jaxmuscle._config import configure
    from jaxmuscle.animation import animate, draw
    from jaxmuscle.diagnosis import Diagnosis, diagnose
    from jaxmuscle.errors import InputError
    from jaxmuscle.estimation import FitResult, fit
    from jaxmuscle.parameters import describe, parameter, replace
    from jaxmuscle.recordings import Card, Recording, read, recording
    from jaxmuscle.recordings import actuator_from_card as actuator
    from jaxmuscle.samples import sample
    from jaxmuscle.simulation.simulate import simulate
    from jaxmuscle.simulation.stepper import stepper
    from jaxmuscle.sweeps import commands, sweep
    from jaxmuscle.tuning import tune

__version__ = "0.2.0"

prepare()

_PLACES = {
    "Card": ("jaxmuscle.recordings", "Card"),
    "Diagnosis": ("jaxmuscle.diagnosis", "Diagnosis"),
    "FitResult": ("jaxmuscle.estimation", "FitResult"),
    "InputError": ("jaxmuscle.errors", "InputError"),
    "Recording": ("jaxmuscle.recordings", "Recording"),
    "actuator": ("jaxmuscle.recordings", "actuator_from_card"),
    "actuators": ("jaxmuscle.actuators", None),
    "analysis": ("jaxmuscle.analysis", None),
    "animate": ("jaxmuscle.animation", "animate"),
    "animation": ("jaxmuscle.animation", None),
    "commands": ("jaxmuscle.sweeps.commands", None),
    "components": ("jaxmuscle.components", None),
    "configure": ("jaxmuscle._config", "configure"),
    "control": ("jaxmuscle.control", None),
    "describe": ("jaxmuscle.parameters", "describe"),
    "diagnose": ("jaxmuscle.diagnosis", "diagnose"),
    "draw": ("jaxmuscle.animation", "draw"),
    "effects": ("jaxmuscle.effects", None),
    "estimation": ("jaxmuscle.estimation", None),
    "fit": ("jaxmuscle.estimation", "fit"),
    "hysteresis": ("jaxmuscle.hysteresis", None),
    "parameter": ("jaxmuscle.parameters", "parameter"),
    "parameters": ("jaxmuscle.parameters", None),
    "read": ("jaxmuscle.recordings", "read"),
    "recording": ("jaxmuscle.recordings", "recording"),
    "recordings": ("jaxmuscle.recordings", None),
    "replace": ("jaxmuscle.parameters", "replace"),
    "robot": ("jaxmuscle.robot", None),
    "sample": ("jaxmuscle.samples", "sample"),
    "signals": ("jaxmuscle.signals", None),
    "simulate": ("jaxmuscle.simulation.simulate", "simulate"),
    "simulation": ("jaxmuscle.simulation", None),
    "stepper": ("jaxmuscle.simulation.stepper", "stepper"),
    "sweep": ("jaxmuscle.sweeps", "sweep"),
    "tune": ("jaxmuscle.tuning", "tune"),
    "tuning": ("jaxmuscle.tuning", None),
}

__all__ = [
    "Card",
    "Diagnosis",
    "FitResult",
    "InputError",
    "Recording",
    "actuator",
    "actuators",
    "analysis",
    "animate",
    "animation",
    "commands",
    "components",
    "configure",
    "control",
    "describe",
    "diagnose",
    "draw",
    "effects",
    "estimation",
    "fit",
    "hysteresis",
    "parameter",
    "parameters",
    "read",
    "recording",
    "recordings",
    "replace",
    "robot",
    "sample",
    "signals",
    "simulate",
    "simulation",
    "stepper",
    "sweep",
    "tune",
    "tuning",
]


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name not in _PLACES:
        raise AttributeError(f"module 'jaxmuscle' has no attribute {name!r}")
    module, attribute = _PLACES[name]
    loaded = importlib.import_module(module)
    return loaded if attribute is None else getattr(loaded, attribute)
