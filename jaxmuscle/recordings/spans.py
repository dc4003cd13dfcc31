"""Spans of a recording's clock, as text: ``2.5:4`` is from 2.5 s to 4 s."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.recording import Recording


def rows_within(recording: Recording, spans: Sequence[str], option: str) -> NDArray[np.bool_]:
    """Rows whose time lies in one of the spans, both ends included.

    Args:
        spans: ``FROM:TO`` in seconds of the recording's own clock; without a number, from its beginning or to
            its end.
        option: what the user calls them, for messages.

    Raises:
        InputError: not such a span, one that ends before it begins, or one with no row in it.
    """
    found = np.zeros(len(recording), dtype=bool)
    for span in spans:
        begin, end = _ends(span, recording, option)
        rows = (recording.time >= begin) & (recording.time <= end)
        if not rows.any():
            raise InputError(
                f"{option} {span}: no row of {recording.name!r} lies there; its clock runs from "
                f"{recording.time[0]:g} s to {recording.time[-1]:g} s"
            )
        found |= rows
    return found


def fraction(text: str, option: str = "--held-out") -> float:
    """A number between 0 and 1.

    Raises:
        InputError: it is none.
    """
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0 < found < 1:
        raise InputError(
            f"{option}: expected a fraction between 0 and 1, or FROM:TO in seconds; got {text!r}"
        )
    return found


def _ends(span: str, recording: Recording, option: str) -> tuple[float, float]:
    expected = f"{option}: expected FROM:TO in seconds of the recording's clock, such as 2.5:4; got {span!r}"
    parts = span.split(":")
    if len(parts) != 2:
        raise InputError(expected)
    try:
        begin = float(parts[0]) if parts[0].strip() else float(recording.time[0])
        end = float(parts[1]) if parts[1].strip() else float(recording.time[-1])
    except ValueError:
        raise InputError(expected) from None
    if not begin <= end:
        raise InputError(f"{option} {span}: expected a span that ends after it begins")
    return begin, end
