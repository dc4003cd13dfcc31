"""Plain data as TOML text (the standard library only reads it)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

NOTHING = {"nothing": True}
"""What stands for `None`, of which TOML has no notion."""


def as_toml(content: Mapping[str, Any]) -> str:
    """A TOML document of mappings, lists, texts, numbers and `None`; keys are quoted.

    Mappings become tables, within lists inline ones; what belongs to a table directly comes first in it.
    """
    return "\n".join(_table(content, ())) + "\n"


def _table(content: Mapping[str, Any], path: Sequence[str]) -> Iterator[str]:
    inner = {key: value for key, value in content.items() if isinstance(value, Mapping)}
    if path:
        yield ""
        yield f"[{'.'.join(map(_text, path))}]"
    for key, value in content.items():
        if key not in inner:
            yield f"{_text(key)} = {_written(value)}"
    for key, value in inner.items():
        yield from _table(value, (*path, key))


def _written(value: Any) -> str:
    if value is None:
        return _written(NOTHING)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(key)} = {_written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_written, value)) + "]"
    if isinstance(value, str):
        return _text(value)
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _text(text: str) -> str:
    # A JSON string is a TOML basic string, but for the DEL character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
