"""A machine as its rig, the values of its parameters and the names of its effects, and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.effects import BY_NAME, is_registered
from jaxmuscle.errors import InputError
from jaxmuscle.parameter_names import of_effect, split_effect
from jaxmuscle.parameters import parameters
from jaxmuscle.recordings import schema


def written_machine(actuator: AbstractActuator) -> dict[str, Any]:
    """What a file keeps of a machine.

    Raises:
        InputError: the machine is of a rig, or has an effect, that a file cannot name.
    """
    known = all(is_registered(name, effect) for name, effect in actuator.effects.items())
    if RIGS.get(actuator.rig) is not type(actuator) or not known:
        raise InputError(
            f"a machine of type {type(actuator).__name__} with effects {', '.join(actuator.effects) or '-'} "
            f"cannot be saved: only registered rigs (jaxmuscle.actuators.register) and effects "
            f"(jaxmuscle.effects.register) have names in a file"
        )
    values = {path: np.asarray(entry.value).tolist() for path, entry in parameters(actuator).items()}
    return {"rig": actuator.rig, "values": values, "effects": list(actuator.effects)}


def machine(data: Mapping[str, Any], file: Path) -> AbstractActuator:
    """The machine that a file keeps.

    Raises:
        InputError: its rig, or one of its effects, is unknown here.
    """
    if data["rig"] not in RIGS:
        raise InputError(
            f"{file}: rig {data['rig']!r} is unknown; if it is your own, import and register it first"
        )
    if unknown := [name for name in data["effects"] if name not in BY_NAME]:
        raise InputError(
            f"{file}: effect {', '.join(map(repr, unknown))} is unknown; if it is your own, import and "
            f"register it first"
        )
    values: dict[str, Any] = dict(data["values"])
    effects = {}
    for name in data["effects"]:
        build: Any = BY_NAME[name]
        effects[name] = build(**of_effect(name, values))
    own = {path: value for path, value in values.items() if split_effect(path)[0] is None}
    return schema.build(RIGS[data["rig"]], own, effects)
