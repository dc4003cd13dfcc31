"""TOML documents of sections whose entries are inline tables: written, and edited with their comments kept
(the standard library only reads TOML).
"""

from __future__ import annotations

import functools
import json
import operator
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import tomlkit

Entry: TypeAlias = Mapping[str, Any] | str
Sections: TypeAlias = Mapping[str, Mapping[str, Entry]]
"""Section name (dots make subsections) → key → text, or entry with texts and numbers; keys are bare."""


def toml_text(heads: Mapping[str, str], sections: Sections) -> str:
    """A TOML document: keys with texts, then sections whose entries are inline tables."""
    lines = [f"{key} = {_written(text)}" for key, text in heads.items()]
    for name, entries in sections.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {entry_text(entry)}" for key, entry in entries.items()]
    return "\n".join(lines) + "\n"


def edited_text(text: str, heads: Mapping[str, tuple[str, str]], before: Sections, now: Sections) -> str:
    """`text`, a TOML document, with what differs between `before` and `now`; all else stays as it stands.

    An entry that goes from one section to another takes the comment behind it along.

    Args:
        heads: keys before the first section → what the text says, what it is to say.
        before, now: what the text says, what it is to say.
    """
    document = tomlkit.parse(text)
    for key, (old, new) in heads.items():
        if old != new:
            document[key] = tomlkit.value(_written(new))
    for name in now:
        if name not in before:
            _section(document, name)
    for name, key in _changed(before, now):
        if key in now.get(name, {}):
            _write(_section(document, name), key, now[name][key], _left(document, key, before, now))
    for name, key in _changed(before, now):
        if key not in now.get(name, {}):
            _section(document, name).remove(key)
    for name in before:
        if name not in now:
            *parents, last = name.split(".")
            functools.reduce(operator.getitem, parents, document).remove(last)
    return tomlkit.dumps(document)


def _changed(before: Sections, now: Sections) -> Iterator[tuple[str, str]]:
    """Section and key of every entry that is not the same in both."""
    for name in dict.fromkeys((*before, *now)):
        old, new = before.get(name, {}), now.get(name, {})
        yield from ((name, key) for key in dict.fromkeys((*old, *new)) if old.get(key) != new.get(key))


def _left(document: Any, key: str, before: Sections, now: Sections) -> Any:
    """The entry of this key that leaves its section, or `None`."""
    names = (name for name in before if key in before[name] and key not in now.get(name, {}))
    return next((_section(document, name)[key] for name in names), None)


def _write(section: Any, key: str, entry: Entry, left: Any) -> None:
    if isinstance(entry, str):
        section[key] = entry
        return
    if key not in section:
        section[key] = tomlkit.value(entry_text(entry)) if left is None else left
    item = section[key]
    for each in [each for each in item if each not in entry]:
        item.remove(each)
    for each, value in entry.items():
        # A number without a unit needs none to be given.
        if item.get(each, "" if each == "unit" else None) != value:
            item[each] = tomlkit.value(_written(value))


def _section(document: Any, name: str) -> Any:
    """The section of a document, made if there is none."""
    node = document
    *parents, last = name.split(".")
    for parent in parents:
        if parent not in node:
            node[parent] = tomlkit.table(is_super_table=True)
        node = node[parent]
    if last not in node:
        node[last] = tomlkit.table()
    return node[last]


def entry_text(entry: Entry) -> str:
    """One entry as TOML: a text, or an inline table of texts and numbers."""
    if isinstance(entry, str):
        return _written(entry)
    return "{ " + ", ".join(f"{key} = {_written(value)}" for key, value in entry.items()) + " }"


def _written(value: str | float) -> str:
    if isinstance(value, str):
        # A JSON string is a TOML basic string, but for the DEL character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value)).removesuffix(".0")
