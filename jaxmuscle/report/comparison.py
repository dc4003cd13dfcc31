"""Several diagnoses side by side: verdicts, effects, errors on unseen data, values with their deviations."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jaxmuscle
from jaxmuscle import formatting
from jaxmuscle.diagnosis.diagnosis_files import is_saved_diagnosis
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.errors import InputError
from jaxmuscle.files import existing_file, file_content
from jaxmuscle.formatting import parameter_words, words
from jaxmuscle.html_template import template
from jaxmuscle.report.report_files import result

RESULT = "result.json"
NONE = "–"


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a ``result.json`` says, by the name under which it is compared."""

    label: str
    said: Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Row:
    """A line of the comparison: what it is, one entry for each outcome, and a remark."""

    name: str
    entries: tuple[str, ...]
    remark: str = ""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Sections of rows, each with an entry for every outcome."""

    labels: tuple[str, ...]
    verdicts: tuple[str, ...]
    sections: Mapping[str, Sequence[Row]]

    def page(self) -> str:
        """As one HTML page that needs nothing else."""
        return template("comparison.html.j2", "jaxmuscle.report").render(
            comparison=self, version=jaxmuscle.__version__
        )


def read_outcomes(paths: Sequence[Path]) -> list[Outcome]:
    """The outcomes in folders of ``jaxmuscle diagnose``, in their ``result.json``, or in saved diagnoses.

    Raises:
        InputError: fewer than two, or one that is not there or holds something else.
    """
    if len(paths) < 2:
        raise InputError(f"expected two diagnoses or more to compare; got {len(paths)}")
    said = [_said(path) for path in paths]
    names = [_label(path) for path in paths]
    unique = len(set(names)) == len(names)
    labels = names if unique else [f"{name} ({i})" for i, name in enumerate(names, 1)]
    return [Outcome(label, each) for label, each in zip(labels, said, strict=True)]


def _said(path: Path) -> Mapping[str, Any]:
    file = path / RESULT if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise InputError(
            f"{path}: no {RESULT} in this folder; expected one that jaxmuscle diagnose wrote (--out)"
        )
    file = existing_file(file, "outcome of a diagnosis", (".json",))
    try:
        content = json.loads(file_content(file).decode("utf-8"))
    except ValueError as error:
        raise InputError(f"{file}: cannot be read as JSON: {error}") from error
    if is_saved_diagnosis(content):
        return result(Diagnosis.load(file))
    kind = content.get("kind") if isinstance(content, Mapping) else None
    what = f"a file of {kind!r}" if isinstance(kind, str) else "something else"
    try:
        compared([Outcome("", content)])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(
            f"{file}: not the outcome of a diagnosis but {what}; expected the {RESULT} of jaxmuscle diagnose "
            f"or a file of Diagnosis.save"
        ) from error
    return content


def _label(path: Path) -> str:
    """The name of a recording, from that of the folder or file."""
    whole = path.resolve()
    name = whole.parent.name if whole.name == RESULT else whole.name if whole.is_dir() else whole.stem
    return name.removeprefix("jaxmuscle-") or name


def compared(outcomes: Sequence[Outcome]) -> Comparison:
    """All of it as texts, in units of the right size."""
    said = [outcome.said for outcome in outcomes]
    verdicts = tuple(str(each["verdict"]) for each in said)
    sections = {
        "Recording": _facts(said),
        "Effects": _effects(said),
        "Error on unseen data": _errors(said),
        "Parameters": _parameters(said),
    }
    kept = {title: rows for title, rows in sections.items() if rows}
    return Comparison(tuple(outcome.label for outcome in outcomes), verdicts, kept)


def _facts(said: Sequence[Mapping[str, Any]]) -> list[Row]:
    missing = [each["missing_in_noise"] for each in said]
    return [
        Row("table", tuple(str(each["recording"]["file"]) for each in said)),
        Row("rig", tuple(str(each["recording"]["rig"]) for each in said)),
        Row("rows", tuple(str(each["recording"]["rows"]) for each in said)),
        Row(
            "still missing",
            tuple(NONE if m is None else f"{formatting.rounded(float(m))} × noise" for m in missing),
        ),
    ]


def _effects(said: Sequence[Mapping[str, Any]]) -> list[Row]:
    """A row for each effect that any of them added."""
    found = [
        {
            _effect_name(effect): _effect(effect, kind == "effects")
            for kind in ("effects", "unconfirmed")
            for effect in each[kind]
        }
        for each in said
    ]
    return [Row(words(name), tuple(each.get(name, NONE) for each in found)) for name in _union(found)]


def _effect_name(effect: Mapping[str, Any]) -> str:
    """Its name in the catalogue, with the column of the sensor whose error it is."""
    return f"{effect['name']}_{effect['column']}" if effect.get("column") else str(effect["name"])


def _effect(effect: Mapping[str, Any], confirmed: bool) -> str:
    values = ", ".join(f"{words(name)} {_value(e)}" for name, e in effect["parameters"].items())
    return values if confirmed else f"{values} (not confirmed)"


def _errors(said: Sequence[Mapping[str, Any]]) -> list[Row]:
    """A row for each predicted column: error before and after, and how many times the noise is left."""
    parts = [(each["before"]["held_out"], each["after"]["held_out"], each["noise"]) for each in said]
    entries = [
        {column: _error(before[column], after[column], noise[column]) for column in after}
        for before, after, noise in parts
    ]
    return [Row(words(name), tuple(each.get(name, NONE) for each in entries)) for name in _union(entries)]


def _error(before: Mapping[str, Any], after: Mapping[str, Any], noise: float | None) -> str:
    if after["rmse"] is None:
        return "not finite"
    left = formatting.quantity(float(after["rmse"]), after["unit"])
    if before["rmse"] is not None and before["rmse"] != after["rmse"]:
        left = f"{formatting.quantity(float(before['rmse']), before['unit'])} → {left}"
    return left if not noise else f"{left} ({formatting.rounded(after['rmse'] / noise)} × noise)"


def _parameters(said: Sequence[Mapping[str, Any]]) -> list[Row]:
    """A row for each fitted parameter, and how far apart its values are in their standard deviations."""
    found = [each["parameters"] for each in said]
    rows = []
    for name in _union(found):
        estimates = [each.get(name) for each in found]
        entries = tuple(NONE if e is None else _value(e) for e in estimates)
        far = _apart([e for e in estimates if e is not None])
        rows.append(Row(parameter_words(name), entries, "" if far is None else f"{far:.1f} σ"))
    return rows


def _apart(estimates: Sequence[Mapping[str, Any]]) -> float | None:
    """Largest difference of two values over its standard deviation; `None` where there is none."""
    known = [(e["value"], e["std"]) for e in estimates if e["value"] is not None and e["std"]]
    pairs = itertools.combinations(known, 2)
    return max((abs(a - b) / math.hypot(s, t) for (a, s), (b, t) in pairs), default=None)


def _value(estimate: Mapping[str, Any]) -> str:
    value, std = (math.nan if estimate[key] is None else float(estimate[key]) for key in ("value", "std"))
    return formatting.estimate(value, std, estimate["unit"])


def _union(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    """All names, in the order in which they first occur."""
    return list(dict.fromkeys(name for part in parts for name in part))
