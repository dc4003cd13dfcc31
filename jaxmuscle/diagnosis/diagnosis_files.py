"""File of a diagnosis: all of it as JSON, read back without loss."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

import jaxmuscle
from jaxmuscle.diagnosis.diagnosis_data import (
    Alternative,
    DiagnosisData,
    Error,
    Estimate,
    FoundEffect,
    Pattern,
    Reveal,
    Round,
    Traces,
    Unexplained,
)
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import fit_files
from jaxmuscle.estimation.fit import FitResult
from jaxmuscle.estimation.serialization import machine, plain, restored
from jaxmuscle.files import atomic_write, existing_file, file_content
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Member, Recording

KIND = "jaxmuscle diagnosis"
FORMAT = 2
Result = TypeVar("Result", bound=DiagnosisData)


def save(diagnosis: DiagnosisData, path: str | Path) -> Path:
    """Write `diagnosis` with its recording, models and fit; numbers keep every bit, SI throughout.

    Raises:
        InputError: the file cannot be written, or a machine is of a rig or has an effect that a file cannot
            name.
    """
    file, fields = Path(path), dataclasses.fields(diagnosis)
    held = {field.name: getattr(diagnosis, field.name) for field in fields}
    recording = diagnosis.recording
    own = {
        "file": _path_text(recording.file),
        "joined_from": [
            {**dataclasses.asdict(each), "file": _path_text(each.file)} for each in recording.joined_from
        ],
    }
    held["recording"] = {f.name: getattr(recording, f.name) for f in dataclasses.fields(recording)} | own
    held["fit"] = None if diagnosis.fit is None else fit_files.content(diagnosis.fit)
    content = {"kind": KIND, "format": FORMAT, "jaxmuscle": jaxmuscle.__version__}
    text = json.dumps({**content, **plain(held)}, ensure_ascii=False, allow_nan=False) + "\n"
    with atomic_write(file) as (unfinished,):
        unfinished.write_text(text, encoding="utf-8", newline="\n")
    return file


def is_saved_diagnosis(content: object) -> bool:
    """Whether what a JSON file holds is a saved diagnosis."""
    return isinstance(content, Mapping) and content.get("kind") == KIND


def load(path: str | Path, kind: type[Result]) -> Result:
    """The diagnosis in a file that :func:`save` wrote, as one of the class `kind`.

    Raises:
        InputError: no such file, or it is not one.
    """
    file = existing_file(Path(path), "saved diagnosis", (".json",))
    try:
        content = json.loads(file_content(file).decode("utf-8"))
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as JSON: {error}") from error
    if not is_saved_diagnosis(content):
        raise InputError(f"{file}: not a diagnosis; expected a file that Diagnosis.save wrote")
    if content["format"] != FORMAT:
        raise InputError(
            f"{file}: written by jaxmuscle {content['jaxmuscle']}, whose files differ; diagnose again"
        )
    return _diagnosis(restored(content), file, kind)


AS_THEY_ARE = (
    "verdict", "refused", "unused", "violated_priors", "missing_in_noise", "share_left", "typical_error",
    "noise", "units", "horizon", "held_out_fraction", "converged", "seconds", "settings",
)  # fmt: skip
"""Fields that JSON holds as they are."""


def _diagnosis(data: Mapping[str, Any], file: Path, kind: type[Result]) -> Result:
    table, reveal, fit = data["correlations"], data["reveal"], data["fit"]
    names = list(table["columns"])
    return kind(
        recording=_recording(data["recording"]),
        effects=tuple(map(_effect, data["effects"])),
        unconfirmed=tuple(map(_effect, data["unconfirmed"])),
        rounds=tuple(_round(each) for each in data["rounds"]),
        declared=machine(data["declared"], file),
        model=machine(data["model"], file),
        fit=None if fit is None else fit_files.from_content(fit, FitResult, file),
        before=_errors(data["before"]),
        after=_errors(data["after"]),
        unexplained=tuple(map(_unexplained, data["unexplained"])),
        parameters=_estimates(data["parameters"]),
        correlations=pd.DataFrame(table["columns"], index=table["index"] if names else None, dtype=float),
        reveal=None if reveal is None else Reveal(**_floats(reveal, "x", "before", "after")),
        traces=_traces(data["traces"]),
        **{name: data[name] for name in AS_THEY_ARE},
    )


def _unexplained(data: Mapping[str, Any]) -> Unexplained:
    pattern = data.get("pattern")
    entries = {"depends_on": tuple(data["depends_on"]), "pattern": Pattern(**pattern) if pattern else None}
    return Unexplained(**{**data, **entries})


def _path_text(file: Path | None) -> str | None:
    return None if file is None else str(file)


def _path(text: str | None) -> Path | None:
    return None if text is None else Path(text)


def _recording(data: Mapping[str, Any]) -> Recording:
    held_out = data.get("held_out")
    return Recording(
        **{
            **data,
            "file": _path(data["file"]),
            "card": Card.from_toml(data["card"]),
            "time": np.array(data["time"], dtype=float),
            "columns": _series(data["columns"]),
            "breaks": tuple(data["breaks"]),
            "ignored": {name: np.array(rows, dtype=bool) for name, rows in data.get("ignored", {}).items()},
            "differences": _series(data.get("differences", {})),
            "held_out": None if held_out is None else np.array(held_out, dtype=bool),
            "joined_from": tuple(
                Member(**{**each, "file": _path(each["file"])}) for each in data.get("joined_from", ())
            ),
        }
    )


def _traces(data: Mapping[str, Any]) -> Traces:
    parts = {name: _series(data[name]) for name in ("measured", "before", "after")}
    return Traces(
        np.array(data["time"], dtype=float),
        **parts,
        windows=np.array(data["windows"], dtype=np.int64),
        held_out=np.array(data["held_out"], dtype=bool),
    )


def _series(data: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.array(values, dtype=float) for name, values in data.items()}


def _floats(data: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {key: np.array(value, dtype=float) if key in names else value for key, value in data.items()}


def _effect(data: Mapping[str, Any]) -> FoundEffect:
    return FoundEffect(**{**data, "parameters": _estimates(data["parameters"])})


def _estimates(data: Mapping[str, Any]) -> dict[str, Estimate]:
    return {name: Estimate(**each) for name, each in data.items()}


def _round(data: Mapping[str, Any]) -> Round:
    ranking = tuple(Alternative(**each) for each in data["ranking"])
    return Round(**{**data, "ranking": ranking, "beside": tuple(data.get("beside", ()))})


def _errors(data: Mapping[str, Any]) -> dict[str, dict[str, Error]]:
    return {
        part: {column: Error(**each) for column, each in columns.items()} for part, columns in data.items()
    }
