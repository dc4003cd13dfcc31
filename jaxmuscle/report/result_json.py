"""A diagnosis as the mapping that ``result.json`` holds: SI throughout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jaxmuscle
from jaxmuscle.diagnosis.result import Diagnosis, Error, Estimate, FoundEffect


def result(diagnosis: Diagnosis) -> dict[str, Any]:
    """The outcome as plain data for JSON; a number that is not finite becomes `None`."""
    recording = diagnosis.recording
    return _finite(
        {
            "verdict": diagnosis.verdict,
            "effects": [_effect(effect) for effect in diagnosis.effects],
            "alternatives": [
                {"name": other.name, "held_out_gain": other.gain, "told_apart": other.told_apart}
                for other in diagnosis.alternatives
            ],
            "before": _errors(diagnosis.before),
            "after": _errors(diagnosis.after),
            "noise": dict(diagnosis.noise),
            "horizon": diagnosis.horizon,
            "held_out_fraction": diagnosis.held_out_fraction,
            "unexplained": [
                {"signal": left.signal, "share": left.share, "depends_on": list(left.depends_on)}
                for left in diagnosis.unexplained
            ],
            "parameters": _estimates(diagnosis.parameters),
            "recording": {
                "file": recording.name if recording.file is None else recording.file.name,
                "sha256": recording.sha256,
                "rig": recording.card.rig,
                "rows": len(recording),
            },
            "jaxmuscle": jaxmuscle.__version__,
            "seconds": diagnosis.seconds,
        }
    )


def _effect(effect: FoundEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "signal": effect.signal,
        "parameters": _estimates(effect.parameters),
        "evidence": {"held_out_gain": effect.gain, "p_value": effect.p_value},
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
