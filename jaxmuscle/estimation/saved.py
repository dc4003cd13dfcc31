"""A fit as a JSON or TOML file, and back without loss."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import jaxmuscle
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.fitted import Fitted, Noise, StartOutcome
from jaxmuscle.estimation.identifiability import Undetermined
from jaxmuscle.estimation.machines import machine
from jaxmuscle.estimation.plain import arrays, pairs, plain, restored, settings, table
from jaxmuscle.estimation.profile import Profile
from jaxmuscle.estimation.rough import RoughWindow
from jaxmuscle.estimation.toml import as_toml
from jaxmuscle.estimation.whiteness import ResidualTest
from jaxmuscle.files import atomic_write, existing_file, file_content
from jaxmuscle.recordings.card import Card

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
    text = as_toml(_content(result)) if _is_toml(file) else as_json(result)
    with atomic_write(file) as (unfinished,):
        unfinished.write_text(text, encoding="utf-8", newline="\n")
    return file


def as_json(result: FitData) -> str:
    """The content of the file: SI units throughout."""
    return json.dumps(_content(result), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _is_toml(file: Path) -> bool:
    return file.suffix.lower() == ".toml"


def _content(result: FitData) -> dict[str, Any]:
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
        content = tomllib.loads(text.decode("utf-8")) if _is_toml(file) else json.loads(text)
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as {form}: {error}") from error
    if not isinstance(content, Mapping) or content.get("kind") != KIND:
        raise InputError(f"{file}: not a fit; expected a file that FitResult.save or jaxmuscle fit wrote")
    if content["format"] != FORMAT:
        raise InputError(
            f"{file}: written by jaxmuscle {content['jaxmuscle']}, whose files differ; fit again"
        )
    data = restored(content)
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
