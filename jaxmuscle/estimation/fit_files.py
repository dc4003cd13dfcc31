"""Files of a fit: a card from which the fitted actuator can be built again, JSON or TOML read back without
loss.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import jaxmuscle
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.fit_data import FitData
from jaxmuscle.estimation.identifiability import Undetermined
from jaxmuscle.estimation.intervals import Fitted, Noise, Profile, StartOutcome
from jaxmuscle.estimation.nonsmooth import RoughWindow
from jaxmuscle.estimation.residual_analysis import ResidualTest
from jaxmuscle.estimation.serialization import (
    arrays,
    as_toml,
    machine,
    pairs,
    plain,
    restored,
    settings,
    table,
)
from jaxmuscle.files import atomic_write, existing_file, file_content
from jaxmuscle.parameter_names import card_name, of_machine, split_effect
from jaxmuscle.parameters import get, parameters
from jaxmuscle.recordings.card import Card, Estimate, actuator_from_card, can_declare


def number_of(result: FitData, recording: str | int) -> int:
    """The number of a recording by its name or number; `InputError` when there is none."""
    names = list(result.cards)
    if isinstance(recording, str):
        if recording not in names:
            raise InputError(f"the fit has no recording {recording!r}{nearest(recording, names)}")
        return names.index(recording)
    if not -len(names) <= recording < len(names):
        raise InputError(f"the fit has {len(names)} recordings; got number {recording}")
    return recording % len(names)


def fitted_card(result: FitData, recording: str | int) -> Card:
    """The card of a recording with fitted values; a machine built from it equals the fitted one.

    Quantities that were not fitted, but differ from the card, become known ones of the machine's value. A
    card has no place for the offset of a sensor, for an initial state, or for an effect whose class is not
    registered or has arrays: they are told in the description.
    """
    number = number_of(result, recording)
    label, card = list(result.cards.items())[number]
    actuator, declared = result.actuators[number], parameters(actuator_from_card(card))
    values: dict[str, Estimate] = {}
    effects: dict[str, dict[str, Estimate]] = {}
    for name, path in actuator.quantities.items():
        if float(get(actuator, path)) != declared[path].value:
            values[name] = (float(get(actuator, path)), None)
    holds = {name for name, effect in actuator.effects.items() if can_declare(name, effect)}
    told = []
    for path, entry in parameters(actuator).items():
        effect, parameter = split_effect(path)
        if effect is None:
            continue
        if effect not in holds:
            told.append(f"{path} = {np.asarray(entry.value).tolist()} {entry.unit}".rstrip())
        elif path not in declared or declared[path].value != entry.value:
            effects.setdefault(effect, {})[parameter] = (float(entry.value), None)
    for name, fitted in result.parameters.items():
        if fitted.recording not in (None, label):
            continue
        estimate = (fitted.value, fitted.std if 0 < fitted.std < math.inf else None)
        if not of_machine(fitted.path):
            told.append(f"{name} = {fitted.value:g} {fitted.unit}")
            continue
        effect, parameter = split_effect(fitted.path)
        if effect in holds:
            effects.setdefault(effect, {})[parameter] = estimate
        elif effect is None:
            values[_quantity(actuator, fitted.path)] = estimate
    return card.updated(values, effects).telling(told)


def _quantity(actuator: AbstractActuator, path: str) -> str:
    name = card_name(actuator.quantities, path)
    if name in actuator.quantities:
        return name
    raise InputError(f"cards of rig {actuator.rig!r} have no name for {path!r}; use fit.actuator instead")


KIND = "jaxmuscle fit"
FORMAT = 1
Result = TypeVar("Result", bound=FitData)


def save(result: FitData, path: str | Path) -> Path:
    """Write `result` as TOML if `path` ends in ``.toml``, else as JSON.

    Numbers keep every bit; those that are not finite are texts.

    Raises:
        InputError: the file cannot be written, or a machine is of a rig that a file cannot name.
    """
    file = Path(path)
    text = as_toml(content(result)) if _is_toml(file) else as_json(result)
    with atomic_write(file) as (unfinished,):
        unfinished.write_text(text, encoding="utf-8", newline="\n")
    return file


def as_json(result: FitData) -> str:
    """The content of the file: SI units throughout."""
    return json.dumps(content(result), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _is_toml(file: Path) -> bool:
    return file.suffix.lower() == ".toml"


def content(result: FitData) -> dict[str, Any]:
    """What the file holds, as plain data; :func:`from_content` makes a result of it again."""
    fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    return {
        "kind": KIND,
        "format": FORMAT,
        "jaxmuscle": jaxmuscle.__version__,
        **{name: plain(value) for name, value in fields.items() if name != "actuator"},
    }


def load(path: str | Path, kind: type[Result]) -> Result:
    """The result in a file that :func:`save` wrote, as one of the class `kind`.

    Raises:
        InputError: no such file, or it is not one.
    """
    file = existing_file(Path(path), "saved fit", (".json", ".toml"))
    text, form = file_content(file), "TOML" if _is_toml(file) else "JSON"
    try:
        found = tomllib.loads(text.decode("utf-8")) if _is_toml(file) else json.loads(text)
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as {form}: {error}") from error
    if not isinstance(found, Mapping) or found.get("kind") != KIND:
        raise InputError(f"{file}: not a fit; expected a file that FitResult.save or jaxmuscle fit wrote")
    if found["format"] != FORMAT:
        raise InputError(f"{file}: written by jaxmuscle {found['jaxmuscle']}, whose files differ; fit again")
    return from_content(restored(found), kind, file)


def from_content(data: Mapping[str, Any], kind: type[Result], file: Path) -> Result:
    """The result of what :func:`content` gave, with its numbers restored; `file` is named in messages."""
    machines = tuple(machine(each, file) for each in data["actuators"])
    return kind(
        actuator=machines[0],
        actuators=machines,
        parameters={name: Fitted(**pairs(each, "prior")) for name, each in data["parameters"].items()},
        correlations=table(data["correlations"]),
        starts=tuple(StartOutcome(**each) for each in data["starts"]),
        profiles=tuple(Profile(**arrays(each, "values", "deviance")) for each in data["profiles"]),
        undetermined=tuple(Undetermined(**each) for each in data["undetermined"]),
        idle=tuple(data["idle"]),
        tests=tuple(ResidualTest(**arrays(each, "lags", "correlation", "band")) for each in data["tests"]),
        noise={r: {c: Noise(**n) for c, n in columns.items()} for r, columns in data["noise"].items()},
        predictions={name: table(each) for name, each in data["predictions"].items()},
        cards={name: Card.from_toml(text) for name, text in data["cards"].items()},
        settings=settings(data["settings"]),
        rough=tuple(RoughWindow(**each) for each in data.get("rough", ())),
        **{name: data[name] for name in ("cost", "samples", "code", "iterations", "seconds")},
    )
