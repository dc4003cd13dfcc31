"""Plain data for JSON, and back: numbers keep every bit, those that are not finite are texts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.loss import Loss
from jaxmuscle.estimation.losses import Huber, Squares, Student
from jaxmuscle.estimation.machines import written_machine
from jaxmuscle.estimation.toml import NOTHING
from jaxmuscle.recordings.card import Card

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
