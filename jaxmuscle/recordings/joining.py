"""Joining of recordings: runs of one bench, one after the other, as one recording with breaks."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.card_rows import Rows
from jaxmuscle.recordings.recording import Member, Recording
from jaxmuscle.recordings.schema import Quantity
from jaxmuscle.units import Series

COMMON = ("rig", "effects", "noise", "horizon", "state_from")
"""Fields of a card that have to be the same for recordings of one bench."""
NUMBERS = ("known", "uncertain")
"""Fields whose values may differ: the same quantities, each with the same standard deviation."""


def joined(recordings: Sequence[Recording], name: str) -> Recording:
    """Runs of one bench, one after the other, as one recording with breaks.

    It keeps the names of what it was joined from, the rows that their cards want to be ignored or held out,
    and the card of the first; by how much values of the other cards are above it stands in `differences`.

    Raises:
        ValueError: no recording, or sampling steps that differ by more than 1 %.
    """
    if not recordings:
        raise ValueError("expected at least one recording to join")
    first, rows = recordings[0], np.cumsum([len(recording) for recording in recordings])
    if any(abs(recording.step - first.step) > 0.01 * first.step for recording in recordings):
        raise ValueError(f"expected one sampling step; got {[recording.step for recording in recordings]}")
    inner = [row + b for r, row in zip(recordings, [0, *rows[:-1]], strict=True) for b in r.breaks]
    return dataclasses.replace(
        first,
        name=name,
        time=first.time[0] + first.step * np.arange(rows[-1]),
        columns={q: np.concatenate([r.columns[q] for r in recordings]) for q in first.columns},
        breaks=tuple(sorted({*map(int, inner), *map(int, rows[:-1])})),
        ignored=_ignored(recordings),
        held_out=_held_out(recordings),
        joined_from=_members(recordings),
        left_out=" ".join(dict.fromkeys(r.left_out for r in recordings if r.left_out)),
        differences=_differences(recordings),
    )


def _differences(recordings: Sequence[Recording]) -> dict[str, Series]:
    """Quantity → by how much it is above the first card's, of those that are not the same everywhere."""
    found = {}
    for name, first in recordings[0].card.quantities.items():
        values = [r.card.quantities.get(name, first).value for r in recordings]
        alike = [first.value if _plain(value) == _plain(first.value) else value for value in values]
        by = [
            np.full(len(r), value - first.value) + r.differences.get(name, 0.0)
            for r, value in zip(recordings, alike, strict=True)
        ]
        if any(part.any() for part in by):
            found[name] = np.concatenate(by)
    return found


def _ignored(recordings: Sequence[Recording]) -> dict[str, Rows]:
    columns = dict.fromkeys(column for recording in recordings for column in recording.ignored)
    none = [np.zeros(len(recording), dtype=bool) for recording in recordings]
    return {
        column: np.concatenate([r.ignored.get(column, no) for r, no in zip(recordings, none, strict=True)])
        for column in columns
    }


def _held_out(recordings: Sequence[Recording]) -> Rows | None:
    if all(recording.held_out is None for recording in recordings):
        return None
    none = [np.zeros(len(recording), dtype=bool) for recording in recordings]
    return np.concatenate(
        [no if r.held_out is None else r.held_out for r, no in zip(recordings, none, strict=True)]
    )


def _members(recordings: Sequence[Recording]) -> tuple[Member, ...]:
    """What was joined, by names of which no two are alike; a recording made of several counts as these."""
    flat, first = [], 0
    for recording in recordings:
        flat += [dataclasses.replace(each, first=first + each.first) for each in recording.members]
        first += len(recording)
    if len(recordings) == 1:
        return recordings[0].joined_from
    names = distinct([member.name for member in flat])
    return tuple(dataclasses.replace(each, name=name) for each, name in zip(flat, names, strict=True))


def distinct(names: Sequence[str]) -> list[str]:
    """The names, no two alike: numbered from the second of the same name on.

    A number that makes another of the names is passed over: ``a-2``, ``a``, ``a`` are ``a-2``, ``a``,
    ``a-3``.
    """
    found: list[str] = []
    for name in names:
        own = name
        if name in found:
            numbered = (f"{name}-{count}" for count in itertools.count(2))
            own = next(each for each in numbered if each not in names and each not in found)
        found.append(own)
    return found


def of_one_bench(recordings: Sequence[Recording]) -> Recording:
    """Several recordings of one bench as one; a single one as it is.

    Values on their cards may differ (another weight on the same machine). What is fitted of such a value, or
    found wrong with it, is one amount for all recordings, as if a scale showed 0.1 kg too little.

    Raises:
        InputError: none, or recordings whose cards tell of different machines or whose sampling steps differ
            by more than 1 %.
    """
    if not recordings:
        raise InputError("expected at least one recording; got none")
    first = recordings[0]
    for other in recordings[1:]:
        for field in (*COMMON, *NUMBERS):
            one, two = (getattr(recording.card, field) for recording in (first, other))
            if field in NUMBERS:
                one, two = ({name: quantity.std for name, quantity in own.items()} for own in (one, two))
            if _plain(one) != _plain(two):
                raise InputError(_difference(first.name, other.name, field, one, two))
    names = distinct([recording.name for recording in recordings])
    if any(abs(recording.step - first.step) > 0.01 * first.step for recording in recordings):
        steps = (f"{name} {recording.step:g} s" for name, recording in zip(names, recordings, strict=True))
        long = "; of long ones not every sample is taken: ask for the same of all with every (--every N)"
        raise InputError(
            f"recordings of one bench: expected one sampling step; got {', '.join(steps)}. Bring them to one "
            f"rate, or take them one by one{long if any(each.left_out for each in recordings) else ''}"
        )
    return first if len(recordings) == 1 else joined(recordings, " + ".join(names))


def _plain(said: object) -> object:
    """What a card says, whatever the unit that it is written in."""
    if isinstance(said, Mapping):
        return {key: _plain(entry) for key, entry in said.items()}
    if isinstance(said, Quantity):
        return _plain(said.value), _plain(said.std)
    return f"{said:.9g}" if isinstance(said, float) else said


def _difference(first: str, other: str, field: str, one: object, two: object) -> str:
    """What two cards say differently."""
    if isinstance(one, dict) and isinstance(two, dict):
        absent = object()
        keys = [
            key
            for key in dict.fromkeys((*one, *two))
            if _plain(one.get(key, absent)) != _plain(two.get(key, absent))
        ]
        where = f"[{field}] {', '.join(keys)}"
    else:
        where = f"{field} ({one} and {two})"
    return (
        f"recordings of one bench: the cards of {first!r} and {other!r} differ in {where}; a diagnosis takes "
        f"recordings of one machine. Of [known] and [uncertain] the values may differ, not what they name or "
        f"its std. Diagnose them one by one (jaxmuscle compare puts the outcomes side by side), or fit them "
        f"together: jaxmuscle fit takes cards that differ"
    )
