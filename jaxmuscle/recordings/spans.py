"""Spans of a recording's clock, as text: ``2.5:4`` is from 2.5 s to 4 s."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.card_rows import Rows, RowSpan
from jaxmuscle.recordings.joining import distinct
from jaxmuscle.recordings.recording import Recording

Clock = NDArray[np.float64]


def rows_within(recording: Recording, spans: Sequence[str], option: str) -> Rows:
    """Rows whose time lies in one of the spans, both ends included.

    Args:
        spans: ``FROM:TO`` in seconds of the recording's own clock; without a number, from its beginning or to
            its end. Of several recordings that were joined ``NAME:FROM:TO``, in seconds of the clock of the
            one of that name, or ``NAME`` for all of it.
        option: what the user calls them, for messages.

    Raises:
        InputError: not such a span, an unknown name, one that ends before it begins, or one with no row in
            it.
    """
    if not recording.joined_from:
        return _rows({recording.name: recording.time}, spans, option)[0]
    clocks = {
        each.name: each.begin + each.step * np.arange(each.rows, dtype=np.float64)
        for each in recording.joined_from
    }
    return np.concatenate(_rows(clocks, spans, option))


def rows_of_each(recordings: Sequence[Recording], spans: Sequence[str], option: str) -> list[Rows]:
    """Rows of each of several recordings; spans, option and errors as of :func:`rows_within`."""
    names = distinct([recording.name for recording in recordings])
    clocks = {name: recording.time for name, recording in zip(names, recordings, strict=True)}
    return _rows(clocks, spans, option)


def held_out_part(recording: Recording, texts: Sequence[str], option: str) -> float | Rows:
    """What is to be held out: a fraction, or rows.

    Args:
        texts: one fraction, or spans as of :func:`rows_within`.

    Raises:
        InputError: something else; a fraction beside a span.
    """
    names = tuple(member.name for member in recording.members)
    spans = [text for text in texts if ":" in text or text in names]
    if not spans and len(texts) == 1 and (not recording.joined_from or _is_number(texts[0])):
        return fraction(texts[0], option)
    if not spans and recording.joined_from:
        _name_and_span(names, texts[0], option)
    if len(spans) < len(texts):
        raise InputError(f"{option}: expected one fraction, or spans only; got {', '.join(texts)}")
    return rows_within(recording, spans, option)


def ends_of_members(recording: Recording, part: float) -> Rows:
    """The last rows, a fraction `part`, of every recording that was joined, or of the single one."""
    found = np.zeros(len(recording), dtype=bool)
    for member in recording.members:
        first = round((1 - part) * member.rows)
        found[member.first + first : member.first + member.rows] = True
    return found


def _rows(clocks: Mapping[str, Clock], spans: Sequence[str], option: str) -> list[Rows]:
    found = {name: np.zeros(len(time), dtype=bool) for name, time in clocks.items()}
    for span in spans:
        name, text = _name_and_span(tuple(clocks), span, option)
        time = clocks[name]
        begin, end = _ends(text, time, option)
        rows = RowSpan(begin, end).rows(time)
        if not rows.any():
            raise InputError(
                f"{option} {span}: no row of {name!r} lies there; its clock runs from {time[0]:g} s to "
                f"{time[-1]:g} s"
            )
        found[name] |= rows
    return list(found.values())


def _name_and_span(names: Sequence[str], span: str, option: str) -> tuple[str, str]:
    """The recording that a span is of, and what is left of its text."""
    if span in names:
        return span, ":"
    name, _, rest = span.partition(":")
    if name in names and rest.count(":") == 1:
        return name, rest
    if len(names) == 1:
        return names[0], span
    raise InputError(
        f"{option} {span}: expected NAME:FROM:TO in seconds of the clock of one of the recordings, or NAME "
        f"for all of it; these are {', '.join(names)}"
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


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


def _ends(span: str, time: Clock, option: str) -> tuple[float, float]:
    expected = f"{option}: expected FROM:TO in seconds of the recording's clock, such as 2.5:4; got {span!r}"
    parts = span.split(":")
    if len(parts) != 2:
        raise InputError(expected)
    try:
        begin = float(parts[0]) if parts[0].strip() else float(time[0])
        end = float(parts[1]) if parts[1].strip() else float(time[-1])
    except ValueError:
        raise InputError(expected) from None
    if not begin <= end:
        raise InputError(f"{option} {span}: expected a span that ends after it begins")
    return begin, end
