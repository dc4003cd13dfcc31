"""Fingerprint of a diagnosis or a fit: what tells it from any other, and a hash of all that it depends on."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxmuscle
from jaxmuscle.files import package_hash
from jaxmuscle.recordings.recording import Recording


def origin(recordings: Sequence[Recording], kinds: Sequence[type], settings: object) -> dict[str, str]:
    """What tells a diagnosis or a fit from any other, part by part (:data:`ORIGINS`).

    Code of one's own counts file by file, in a notebook class by class.

    Args:
        kinds: the rig, and effects: classes whose code counts.
        settings: all else that was asked for.
    """
    cards = [dataclasses.replace(r.card, description="", file=None, text=None) for r in recordings]
    data = [(r.time, r.step, r.columns, r.breaks) for r in recordings]
    rows = [
        (r.ignored, r.held_out, r.differences, [each.first for each in r.joined_from]) for r in recordings
    ]
    device = jax.local_devices()[0].device_kind
    return {
        "version": ", ".join([jaxmuscle.__version__, jax.__version__, np.__version__, device]),
        "code": digest(package_hash(), [(each.__qualname__, _code_of(each)) for each in kinds]),
        "recording": digest(data, rows),
        "card": digest([card.to_toml() for card in cards]),
        "settings": digest(settings, [each.__qualname__ for each in kinds]),
    }


ORIGINS = {
    "version": "another version of jaxmuscle, JAX or NumPy, or another kind of device",
    "code": "other code of jaxmuscle, rig or effects",
    "recording": "another recording, or other rows of it",
    "card": "another card",
    "settings": "other settings",
}
"""Part of :func:`origin` → what is said where it differs."""


def digest(*parts: object) -> str:
    """A hash of models, records, arrays to the last bit, texts and numbers in any nesting."""
    found = hashlib.sha256()
    for piece in _pieces(parts):
        found.update(piece + b"\0")
    return found.hexdigest()


def _pieces(node: Any) -> Iterator[bytes]:
    """What tells a value from others, with its place among them."""
    if hasattr(node, "__array__"):
        array = np.ascontiguousarray(node)
        yield f"{array.shape} {array.dtype}".encode()
        yield array.tobytes()
        return
    if dataclasses.is_dataclass(node) and not isinstance(node, type):
        entries = [(field.name, getattr(node, field.name)) for field in dataclasses.fields(node)]
    elif isinstance(node, Mapping):
        entries = sorted(node.items(), key=lambda item: repr(item[0]))
    elif isinstance(node, list | tuple):
        entries = list(enumerate(node))
    else:
        # Of functions and classes the address in memory is another one in each process.
        yield str(getattr(node, "__qualname__", repr(node))).encode()
        return
    yield f"{type(node).__qualname__} of {len(entries)}".encode()
    for name, value in entries:
        yield repr(name).encode()
        yield from _pieces(value)


def _code_of(kind: type) -> str:
    """A hash of the file that a class is from, or of the class where there is none (a notebook)."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    with contextlib.suppress(OSError, TypeError):
        return text_hash(Path(file).read_text("utf-8") if file else inspect.getsource(kind))
    return ""


def text_hash(text: str) -> str:
    """A hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()
