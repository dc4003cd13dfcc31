"""A fit as a JSON file, and back without loss."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

import jaxmuscle
from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.effects import BY_NAME
from jaxmuscle.errors import InputError, existing_file, file_content
from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.fitted import Fitted, Noise, StartOutcome
from jaxmuscle.estimation.identifiability import Undetermined
from jaxmuscle.estimation.losses import Huber, Loss, Squares, Student
from jaxmuscle.estimation.profile import Profile
from jaxmuscle.estimation.rough import RoughWindow
from jaxmuscle.estimation.whiteness import ResidualTest
from jaxmuscle.parameters import parameters
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card

KIND = "jaxmuscle fit"
FORMAT = 1
Result = TypeVar("Result", bound=FitData)
RULES = {"squares": Squares, "huber": Huber, "student": Student}


def save(result: FitData, path: str | Path) -> Path:
    """Write `result` as JSON. Numbers keep every bit; those that are not finite are texts.

    Raises:
        InputError: the file cannot be written, or a machine is of a rig that a file cannot name.
    """
    file, text = Path(path), as_json(result)
    try:
        handle, waiting = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as opened:
            opened.write(text)
        Path(waiting).replace(file)
    except OSError as error:
        raise InputError(f"cannot write {str(file)!r}: {error.strerror}") from error
    return file


def as_json(result: FitData) -> str:
    """The content of the file: SI units throughout."""
    fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    content = {
        "kind": KIND,
        "format": FORMAT,
        "jaxmuscle": jaxmuscle.__version__,
        **{name: _plain(value) for name, value in fields.items() if name != "actuator"},
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def load(path: str | Path, kind: type[Result]) -> Result:
    """The result in a file that :func:`save` wrote, as one of the class `kind`.

    Raises:
        InputError: no such file, or it is not one.
    """
    file = existing_file(Path(path), "saved fit", (".json",))
    try:
        content = json.loads(file_content(file))
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as JSON: {error}") from error
    if not isinstance(content, Mapping) or content.get("kind") != KIND:
        raise InputError(f"{file}: not a fit; expected a file that FitResult.save or jaxmuscle fit wrote")
    if content["format"] != FORMAT:
        raise InputError(
            f"{file}: written by jaxmuscle {content['jaxmuscle']}, whose files differ; fit again"
        )
    data = _restored(content)
    machines = tuple(_machine(machine, file) for machine in data["actuators"])
    return kind(
        actuator=machines[0],
        actuators=machines,
        parameters={name: Fitted(**_pairs(each, "prior")) for name, each in data["parameters"].items()},
        correlations=_table(data["correlations"]),
        starts=tuple(StartOutcome(**each) for each in data["starts"]),
        profiles=tuple(Profile(**_arrays(each, "values", "deviance")) for each in data["profiles"]),
        undetermined=tuple(Undetermined(**each) for each in data["undetermined"]),
        idle=tuple(data["idle"]),
        tests=tuple(ResidualTest(**_arrays(each, "lags", "correlation", "band")) for each in data["tests"]),
        noise={r: {c: Noise(**n) for c, n in columns.items()} for r, columns in data["noise"].items()},
        predictions={name: _table(each) for name, each in data["predictions"].items()},
        cards={name: Card.parse(tomllib.loads(text)) for name, text in data["cards"].items()},
        settings=_settings(data["settings"]),
        rough=tuple(RoughWindow(**each) for each in data.get("rough", ())),
        **{name: data[name] for name in ("cost", "samples", "code", "iterations", "seconds")},
    )


def _plain(node: Any) -> Any:
    """Plain data for JSON."""
    if isinstance(node, AbstractActuator):
        return _written_machine(node)
    if isinstance(node, Card):
        return node.to_toml()
    if isinstance(node, Loss):
        name = next(name for name, rule in RULES.items() if isinstance(node, rule))
        return (
            {"name": name, **dataclasses.asdict(node)} if dataclasses.is_dataclass(node) else {"name": name}
        )
    if isinstance(node, pd.DataFrame):
        columns = {str(name): _plain(node[name].to_numpy()) for name in node.columns}
        return {"index": _plain(node.index.to_numpy()), "name": node.index.name, "columns": columns}
    if dataclasses.is_dataclass(node):
        return {field.name: _plain(getattr(node, field.name)) for field in dataclasses.fields(node)}
    if isinstance(node, Mapping):
        return {str(name): _plain(value) for name, value in node.items()}
    if isinstance(node, np.ndarray):
        return _plain(node.tolist())
    if isinstance(node, list | tuple):
        return [_plain(value) for value in node]
    if isinstance(node, float) and not math.isfinite(node):
        return {"number": repr(node)}
    return node


def _restored(node: Any) -> Any:
    """The inverse for numbers that are not finite."""
    if isinstance(node, dict):
        return (
            float(node["number"]) if set(node) == {"number"} else {k: _restored(v) for k, v in node.items()}
        )
    return [_restored(value) for value in node] if isinstance(node, list) else node


def _written_machine(actuator: AbstractActuator) -> dict[str, Any]:
    if RIGS.get(actuator.rig) is not type(actuator) or not set(actuator.effects) <= set(BY_NAME):
        raise InputError(
            f"a machine of type {type(actuator).__name__} with effects {', '.join(actuator.effects) or '-'} "
            f"cannot be saved: only registered rigs (jaxmuscle.actuators.register) and the effects of the "
            f"package have names in a file"
        )
    values = {path: np.asarray(entry.value).tolist() for path, entry in parameters(actuator).items()}
    return {"rig": actuator.rig, "values": _plain(values), "effects": list(actuator.effects)}


def _machine(data: Mapping[str, Any], file: Path) -> AbstractActuator:
    if data["rig"] not in RIGS:
        raise InputError(
            f"{file}: rig {data['rig']!r} is unknown; if it is your own, import and register it first"
        )
    values: dict[str, Any] = dict(data["values"])
    effects = {}
    for name in data["effects"]:
        prefix, kind = f"effects.{name}.", BY_NAME[name]
        own = {
            path.removeprefix(prefix): values.pop(path) for path in list(values) if path.startswith(prefix)
        }
        build: Any = kind
        effects[name] = build(**own)
    return schema.build(RIGS[data["rig"]], values, effects)


def _settings(data: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(data)
    loss = dict(found["loss"])
    found["loss"] = RULES[loss.pop("name")](**loss)
    for name in ("priors", "bounds"):
        found[name] = {key: None if pair is None else tuple(pair) for key, pair in found[name].items()}
    return found


def _table(data: Mapping[str, Any]) -> pd.DataFrame:
    columns = {name: np.array(values, dtype=float) for name, values in data["columns"].items()}
    return pd.DataFrame(columns, index=pd.Index(data["index"], name=data["name"]))


def _arrays(data: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {key: np.array(value) if key in names else value for key, value in data.items()}


def _pairs(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    pair = data[name]
    return {**data, name: None if pair is None else tuple(pair)}
