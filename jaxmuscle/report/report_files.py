"""Files that `jaxmuscle diagnose` and `jaxmuscle fit` leave behind: all of them, or none; SI throughout."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jaxmuscle
from jaxmuscle.diagnosis.diagnosis_data import Error, Estimate, FoundEffect
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import FitResult
from jaxmuscle.estimation.fit_files import as_json
from jaxmuscle.files import atomic_folder
from jaxmuscle.formatting import words
from jaxmuscle.parameter_names import effect_path, split_effect
from jaxmuscle.parameters import parameters
from jaxmuscle.recordings.card import Card, can_declare
from jaxmuscle.recordings.card import Estimate as CardEstimate
from jaxmuscle.report.page import page
from jaxmuscle.report.tables import differing


def result(diagnosis: Diagnosis) -> dict[str, Any]:
    """The outcome as plain data for JSON; a number that is not finite becomes `None`."""
    recording = diagnosis.recording
    several = bool(recording.joined_from)
    return _finite(
        {
            "verdict": diagnosis.verdict,
            "effects": [_effect(effect) for effect in diagnosis.effects],
            "unconfirmed": [_effect(effect) for effect in diagnosis.unconfirmed],
            "unused_readings": diagnosis.unused,
            "refused": [{"name": name, "why": why} for name, why in diagnosis.refused.items()],
            "violated_priors": [
                {"name": name, "standard_deviations": far} for name, far in diagnosis.violated_priors.items()
            ],
            "missing_in_noise": diagnosis.missing_in_noise,
            "alternatives": [
                {
                    "name": other.name,
                    "held_out_gain": other.gain if other.judged else None,
                    "told_apart": other.told_apart,
                }
                for other in diagnosis.alternatives
            ],
            "before": _errors(diagnosis.before),
            "after": _errors(diagnosis.after),
            "noise": dict(diagnosis.noise),
            "horizon": diagnosis.horizon,
            "state_from": recording.card.state_from,
            "held_out_fraction": diagnosis.held_out_fraction,
            "unexplained": [
                {"signal": left.signal, "share": left.share, "depends_on": list(left.depends_on)}
                | ({"pattern": dataclasses.asdict(left.pattern)} if left.pattern else {})
                for left in diagnosis.unexplained
            ],
            "parameters": _estimates(diagnosis.parameters),
            "recording": {
                "file": recording.name if recording.file is None or several else recording.file.name,
                "sha256": None if several else recording.sha256,
                "rig": recording.card.rig,
                "rows": len(recording),
                **({"left_out": recording.left_out} if recording.left_out else {}),
            },
            **({"recordings": _members(diagnosis)} if recording.joined_from else {}),
            "jaxmuscle": jaxmuscle.__version__,
            "seconds": diagnosis.seconds,
        }
    )


def _members(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Each of several recordings: its table, how many rows it has and how many of them are held out."""
    return [
        {
            "name": member.name,
            "file": member.name if member.file is None else member.file.name,
            "sha256": member.sha256,
            "rows": member.rows,
            **({"left_out": member.left_out} if member.left_out else {}),
            **({"values": values} if (values := diagnosis.recording.differing(member)) else {}),
            "held_out_rows": int(diagnosis.traces.held_out[rows].sum()),
        }
        for member in diagnosis.recording.joined_from
        for rows in (slice(member.first, member.first + member.rows),)
    ]


def _effect(effect: FoundEffect) -> dict[str, Any]:
    return {
        "name": effect.kind,
        **({"column": effect.column} if effect.column else {}),
        **({"on_the_card": effect.declared} if effect.is_constant else {}),
        "signal": effect.signal,
        "parameters": _estimates(effect.parameters),
        "evidence": {"held_out_gain": effect.gain, "p_value": effect.p_value, "test": effect.test},
    }


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: {"value": e.value, "std": e.std, "unit": e.unit} for name, e in estimates.items()}


def _errors(parts: Mapping[str, Mapping[str, Error]]) -> dict[str, Any]:
    return {
        part: {column: {"rmse": e.rmse, "unit": e.unit, "nrmse": e.nrmse} for column, e in errors.items()}
        for part, errors in parts.items()
    }


def _finite(node: Any) -> Any:
    """`node` with plain floats, and `None` for those that JSON cannot hold."""
    if isinstance(node, dict):
        return {key: _finite(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_finite(value) for value in node]
    if node is None or isinstance(node, str | bool | int):
        return node
    return float(node) if math.isfinite(node) else None


def write(diagnosis: Diagnosis, folder: str | Path, report: bool = True) -> list[Path]:
    """Write ``result.json``, ``card.toml`` and, unless `report` is false, ``report.html`` into `folder`.

    Everything is rendered before the first file is touched; see :func:`jaxmuscle.files.atomic_folder`.

    Returns:
        The files written.

    Raises:
        InputError: `folder` is a file, or cannot be written.
    """
    texts = {
        "result.json": json.dumps(result(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        "card.toml": fitted_card(diagnosis).to_toml(),
    }
    if report:
        texts["report.html"] = page(diagnosis)
    return placed(texts, writable_folder(folder))


def writable_folder(folder: str | Path) -> Path:
    """`folder` as a path; `InputError` when nothing can be written there. Makes nothing."""
    path = Path(folder)
    there = next((p for p in (path, *path.absolute().parents) if p.exists()), path)
    if not there.is_dir():
        raise InputError(
            f"cannot write into {str(path)!r}: {str(there)!r} is not a folder; name another with --out"
        )
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(
            f"cannot write into {str(path)!r}: no permission for {str(there)!r}; name another with --out"
        )
    return path


def fitted_card(diagnosis: Diagnosis) -> Card:
    """The recording's card with the fitted values and the added effects; it reads back as a card.

    Of several recordings it is the first one's; values that differ in the others are told.

    An added effect of a class of the user's own that is not registered (:func:`jaxmuscle.effects.register`)
    has no name in a card: its values are told in the description.
    """
    values: dict[str, CardEstimate] = {}
    effects: dict[str, dict[str, CardEstimate]] = {}
    told: list[str] = []
    machine = diagnosis.model.effects
    holds = {name for name, effect in machine.items() if can_declare(name, effect)}
    # Parameters of an added effect that were not fitted are still part of it.
    found = {effect.name for effect in diagnosis.added}
    for path, entry in parameters(diagnosis.model).items():
        effect, name = split_effect(path)
        if effect is not None and effect not in holds:
            told.append(f"{path} = {entry.value} {entry.unit}".rstrip())
        elif effect in found:
            effects.setdefault(str(effect), {})[name] = (float(entry.value), None)
    fitted = {
        name if e.is_constant else effect_path(e.name, name): value
        for e in diagnosis.added
        for name, value in e.parameters.items()
    }
    for path, estimate in {**fitted, **diagnosis.parameters}.items():
        effect, name = split_effect(path)
        if effect is None:
            values[name] = _card_estimate(estimate)
        elif effect in holds:
            effects.setdefault(effect, {})[name] = _card_estimate(estimate)
    told += [f"{words(effect.name)}: not confirmed" for effect in diagnosis.unconfirmed]
    recording = diagnosis.recording
    for each in recording.members[1:]:
        if text := differing(recording, each, diagnosis.model):
            told.append(f"{text} in {each.name}")
    return recording.card.updated(values, effects).telling(told)


def _card_estimate(estimate: Estimate) -> CardEstimate:
    return estimate.value, estimate.std if 0 < estimate.std < float("inf") else None


def placed(texts: Mapping[str, str], folder: Path) -> list[Path]:
    """Write `texts`, by names, into `folder`: all of them, or none."""
    with atomic_folder(folder, texts) as unfinished:
        for file, text in zip(unfinished, texts.values(), strict=True):
            file.write_text(text, encoding="utf-8", newline="\n")
    return [folder / name for name in texts]


def write_fit(result: FitResult, folder: str | Path) -> list[Path]:
    """Write ``result.json`` and a card with the fitted values for each recording: all of them, or none.

    The first recording's card is ``card.toml``, the others' ``card-NAME.toml``.

    Returns:
        The files written.

    Raises:
        InputError: `folder` is a file, or cannot be written; a value that a card has no place for.
    """
    names = list(result.cards)
    texts = {"result.json": as_json(result)}
    for number, name in enumerate(names):
        texts[f"card-{name}.toml" if number else "card.toml"] = result.to_card(name).to_toml()
    return placed(texts, writable_folder(folder))
