"""The files that a diagnosis leaves behind: all of them, or none."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from jaxmuscle.diagnosis.result import Diagnosis, Estimate
from jaxmuscle.errors import InputError
from jaxmuscle.files import atomic_write
from jaxmuscle.parameter_names import effect_path, split_effect
from jaxmuscle.parameters import parameters
from jaxmuscle.recordings.card import Card, can_declare
from jaxmuscle.recordings.card import Estimate as CardEstimate
from jaxmuscle.report.page import page
from jaxmuscle.report.result_json import result


def write(diagnosis: Diagnosis, folder: str | Path, report: bool = True) -> list[Path]:
    """Write ``result.json``, ``card.toml`` and, unless `report` is false, ``report.html`` into `folder`.

    Everything is rendered before the first file is touched; each file is then renamed into place.

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

    An added effect of a class of the user's own that is not registered (:func:`jaxmuscle.effects.register`)
    has no name in a card: its values are told in the description.
    """
    values: dict[str, CardEstimate] = {}
    effects: dict[str, dict[str, CardEstimate]] = {}
    told: list[str] = []
    machine = diagnosis.model.effects
    holds = {name for name, effect in machine.items() if can_declare(name, effect)}
    # Parameters of an added effect that were not fitted are still part of it.
    found = {effect.name for effect in diagnosis.effects}
    for path, entry in parameters(diagnosis.model).items():
        effect, name = split_effect(path)
        if effect is not None and effect not in holds:
            told.append(f"{path} = {entry.value} {entry.unit}".rstrip())
        elif effect in found:
            effects.setdefault(str(effect), {})[name] = (float(entry.value), None)
    fitted = {
        effect_path(e.name, name): value for e in diagnosis.effects for name, value in e.parameters.items()
    }
    for path, estimate in {**fitted, **diagnosis.parameters}.items():
        effect, name = split_effect(path)
        if effect is None:
            values[name] = _card_estimate(estimate)
        elif effect in holds:
            effects.setdefault(effect, {})[name] = _card_estimate(estimate)
    return diagnosis.recording.card.updated(values, effects).telling(told)


def _card_estimate(estimate: Estimate) -> CardEstimate:
    return estimate.value, estimate.std if 0 < estimate.std < float("inf") else None


def placed(texts: Mapping[str, str], folder: Path) -> list[Path]:
    """Write `texts`, by names, into `folder`: all of them, or none."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write into {str(folder)!r}: {error.strerror}") from error
    files = [folder / name for name in texts]
    with atomic_write(*files) as unfinished:
        for file, text in zip(unfinished, texts.values(), strict=True):
            file.write_text(text, encoding="utf-8", newline="\n")
    return files
