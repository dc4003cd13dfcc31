"""Sections of a card as TOML text (the standard library only reads it)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def toml_text(heads: Mapping[str, str], sections: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """A TOML document: keys with texts, then sections whose entries are inline tables.

    Args:
        heads: keys before the first section.
        sections: section name (dots make subsections) → key → entry; texts and numbers in an entry.
            Keys are bare: letters, digits, underscores.
    """
    lines = [f"{key} = {_written(text)}" for key, text in heads.items()]
    for name, entries in sections.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_inline(entry)}" for key, entry in entries.items()]
    return "\n".join(lines) + "\n"


def _inline(entry: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f"{key} = {_written(value)}" for key, value in entry.items()) + " }"


def _written(value: str | float) -> str:
    if isinstance(value, str):
        # A JSON string is a TOML basic string, but for the DEL character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value)).removesuffix(".0")
