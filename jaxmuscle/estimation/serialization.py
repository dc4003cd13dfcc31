"""Serialization: actuators, losses and arrays as plain data for JSON and TOML, and back without loss."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects import effect_named, is_registered
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.losses import Huber, Loss, Squares, Student
from jaxmuscle.parameter_names import of_effect, split_effect
from jaxmuscle.parameters import parameters
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card

NOTHING = {"nothing": True}
"""What stands for `None`, of which TOML has no notion."""


def as_toml(content: Mapping[str, Any]) -> str:
    """A TOML document of mappings, lists, texts, numbers and `None`; keys are quoted where they have to be.

    Mappings become tables, within lists inline ones; what belongs to a table directly comes first in it.
    """
    return "\n".join(_table(content, ())) + "\n"


def _table(content: Mapping[str, Any], path: Sequence[str]) -> Iterator[str]:
    inner = {key: value for key, value in content.items() if isinstance(value, Mapping)}
    if path:
        yield ""
        yield f"[{'.'.join(map(_key, path))}]"
    for key, value in content.items():
        if key not in inner:
            yield f"{_key(key)} = {_written(value)}"
    for key, value in inner.items():
        yield from _table(value, (*path, key))


def _written(value: Any) -> str:
    if value is None:
        return _written(NOTHING)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)} = {_written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_written, value)) + "]"
    if isinstance(value, str):
        return _text(value)
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _text(name)


def _text(text: str) -> str:
    # A JSON string is a TOML basic string, but for the DEL character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


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
    if unknown := [name for name in data["effects"] if effect_named(name) is None]:
        raise InputError(
            f"{file}: effect {', '.join(map(repr, unknown))} is unknown; if it is your own, import and "
            f"register it first"
        )
    values: dict[str, Any] = dict(data["values"])
    rig, effects = RIGS[data["rig"]], {}
    for name in data["effects"]:
        build: Any = rig.effect_named(name)
        effects[name] = build(**of_effect(name, values))
    own = {path: value for path, value in values.items() if split_effect(path)[0] is None}
    return schema.build(rig, own, effects)


RULES: dict[str, Any] = {"squares": Squares, "huber": Huber, "student": Student}
"""Loss rules by name."""


def plain(node: Any) -> Any:
    """Machines, cards, loss rules, tables, arrays and data classes as plain data.

    Raises:
        InputError: a machine or a loss that a file cannot name.
    """
    if isinstance(node, AbstractActuator):
        return plain(written_machine(node))
    if isinstance(node, Card):
        return node.to_toml()
    if isinstance(node, Loss):
        return _plain_loss(node)
    if isinstance(node, pd.DataFrame):
        columns = {str(name): plain(node[name].to_numpy()) for name in node.columns}
        return {"index": plain(node.index.to_numpy()), "name": node.index.name, "columns": columns}
    if dataclasses.is_dataclass(node):
        return {field.name: plain(getattr(node, field.name)) for field in dataclasses.fields(node)}
    if isinstance(node, Mapping):
        return {str(name): plain(value) for name, value in node.items()}
    if isinstance(node, np.ndarray):
        return plain(node.tolist())
    if isinstance(node, list | tuple):
        return [plain(value) for value in node]
    if isinstance(node, np.generic):
        return plain(node.item())
    if isinstance(node, float) and not math.isfinite(node):
        return {"number": repr(node)}
    return node


def _plain_loss(loss: Loss) -> dict[str, Any]:
    for name, rule in RULES.items():
        if isinstance(loss, rule):
            return {"name": name, **{key: plain(value) for key, value in vars(loss).items()}}
    raise InputError(
        f"a fit with the loss {type(loss).__name__} cannot be saved: only {', '.join(RULES)} have names in a "
        f"file"
    )


def restored(node: Any) -> Any:
    """The inverse of :func:`plain` for numbers that are not finite, and of TOML's stand-in for `None`."""
    if node == NOTHING:
        return None
    if isinstance(node, dict):
        return float(node["number"]) if set(node) == {"number"} else {k: restored(v) for k, v in node.items()}
    return [restored(value) for value in node] if isinstance(node, list) else node


def settings(data: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a fit: the loss as a rule, priors and bounds as pairs."""
    found = dict(data)
    loss = dict(found["loss"])
    found["loss"] = RULES[loss.pop("name")](**loss)
    for name in ("priors", "bounds"):
        found[name] = {key: None if pair is None else tuple(pair) for key, pair in found[name].items()}
    return found


def table(data: Mapping[str, Any]) -> pd.DataFrame:
    """A table of numbers with its index."""
    columns = {name: np.array(values, dtype=float) for name, values in data["columns"].items()}
    return pd.DataFrame(columns, index=pd.Index(data["index"], name=data["name"]))


def arrays(data: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """`data` with the named entries as arrays."""
    return {key: np.array(value) if key in names else value for key, value in data.items()}


def pairs(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """`data` with the named entry as a pair, or as `None`."""
    pair = data[name]
    return {**data, name: None if pair is None else tuple(pair)}
