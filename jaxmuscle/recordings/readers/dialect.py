"""Dialect of a delimited text: separator, decimal sign, comment lines, where names and units stand.

Told from the first lines by the one separator that makes most of their fields numbers.
"""

from __future__ import annotations

import csv
import dataclasses
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.clocks import is_stamp
from jaxmuscle.units import unit_in

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "blank"}
"""What may stand between columns, the likeliest first, and what messages call it."""
COMMENT = re.compile(r"[ \t]*(#|%(?=[\s%]|$)|//)")
"""How a comment line begins; ``%RH`` is the name of a column."""
POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
COMMA = re.compile(r"[+-]?(\d+(,\d+)?|,\d+)([eE][+-]?\d+)?")
FRACTION = {".": re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?"), ",": re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")}
NO_NUMBER = frozenset({"nan", "inf", "+inf", "-inf", "na", "n/a", "null", "none"})
UNLIKE = 0.5
"""Share of fields that have to be numbers for a text to count as a table of them."""

Line = tuple[int, list[str]]
"""Index of a line in the file, from 0, and its fields."""


@dataclasses.dataclass(frozen=True)
class Dialect:
    """How a text is laid out; indices of lines count from 0.

    Attributes:
        separator: a key of :data:`SEPARATORS`.
        decimal: ``"."`` or ``","``; `None` where no number seen has a fraction.
        names: of the columns.
        header: line of the names.
        units: what stands below the names; `None` where nothing does.
        first: line of the first row of samples, as far as there is one.
        trailing: whether every line of samples ends with a separator that the names have not.
        commented: whether the names stand in a comment line.
    """

    separator: str
    decimal: str | None
    names: tuple[str, ...]
    header: int
    units: tuple[str, ...] | None
    first: int
    trailing: bool
    commented: bool


def is_comment(line: str) -> bool:
    """Whether a line begins with ``#``, ``%`` or ``//``."""
    return COMMENT.match(line) is not None


def dialect_of(lines: Sequence[str]) -> Dialect:
    """The dialect of a text by its first lines.

    Raises:
        InputError: there are no names, numbers have points here and commas there, or rows are longer than
            the line of names.
    """
    body = [(i, line) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    separator = _separator([line for _, line in body])
    rows = [(i, fields_of(line, separator)) for i, line in body]
    if not rows:
        raise InputError("cannot be read as a comma-separated table: it is empty")
    width = _width([row for _, row in rows[1:] or rows])
    decimal = _decimal((field for _, row in rows if len(row) == width for field in row), separator)
    header = _header(rows, width) or _commented(lines, rows, separator, width)
    if header is None:
        raise InputError(
            "no line of names: the first line holds numbers; write the names of the columns above"
        )
    index, names = header
    below = [row for row in rows if row[0] > index]
    units = below[0] if below and are_units(below[0][1], names) else None
    samples = below[1:] if units else below
    if samples and _longer(samples, names):
        raise InputError(
            f"rows hold more fields than row {index + 1} holds names ({len(names)}); mend row {index + 1}, "
            f"or write points in the numbers if they have commas"
        )
    if samples and names[-1] and 2 * sum(len(row) < len(names) for _, row in samples) > len(samples):
        raise InputError(
            f"row {index + 1} holds {len(names)} names, the rows below fewer fields, most of them {width}; "
            f"mend row {index + 1}: a name that holds a separator has to stand in quotes"
        )
    trailing = bool(samples) and all(len(row) == len(names) + 1 and not row[-1] for _, row in samples)
    return Dialect(
        separator,
        decimal,
        tuple(names),
        index,
        tuple(units[1]) if units else None,
        samples[0][0] if samples else index + 1,
        trailing,
        is_comment(lines[index]),
    )


def fields_of(line: str, separator: str) -> list[str]:
    """The fields of a line; a separator within quotes is part of a field."""
    if separator == " ":
        return line.split()
    reader = csv.reader([line], delimiter=separator, skipinitialspace=separator != "\t")
    return [field.strip() for field in next(reader, [])]


def _separator(lines: Sequence[str]) -> str:
    """The separator that makes the largest share of fields numbers; by the first line where none does."""
    best, most = "", 0.0
    for separator in SEPARATORS:
        share = _share_of_numbers([fields_of(line, separator) for line in lines], separator)
        if share > most:
            best, most = separator, share
    if most >= UNLIKE or not lines:
        return best or ","
    whole = [s for s in SEPARATORS if s != " " and _holds_together([fields_of(line, s) for line in lines])]
    return whole[0] if whole else ","


def _share_of_numbers(rows: Sequence[Sequence[str]], separator: str) -> float:
    """Share of numbers among the fields of those rows that are as long as most; 0 for a single column."""
    width = _width(rows[1:] or rows)
    if width < 2:
        return 0.0
    shares = []
    for sign in (".", ","):
        good = sum(_is_entry(f, sign, separator) for row in rows[1:] if len(row) == width for f in row)
        shares.append(good / max(1, sum(map(len, rows[1:]))))
    return max(shares)


def _width(rows: Sequence[Sequence[str]]) -> int:
    """The commonest number of fields, the larger one of two that are as common."""
    counts = Counter(len(row) for row in rows)
    return max(counts, key=lambda width: (counts[width], width), default=0)


def _holds_together(rows: Sequence[Sequence[str]]) -> bool:
    if not rows or len(rows[0]) < 2:
        return False
    return 2 * sum(len(row) == len(rows[0]) for row in rows[1:]) >= len(rows) - 1


def _is_entry(field: str, sign: str, separator: str) -> bool:
    """Whether a field is a number with this decimal sign, a time stamp or a mark for none.

    Blanks make columns only of numbers: words of a sentence are none.
    """
    form = POINT if sign == "." else COMMA
    there = field.lower() in NO_NUMBER if field else separator != " "
    return bool(form.fullmatch(field)) or there or is_stamp(field)


def is_number(field: str) -> bool:
    """Whether a field is a number with a point or a comma, or a time stamp."""
    return bool(POINT.fullmatch(field) or COMMA.fullmatch(field)) or is_stamp(field)


def _decimal(fields: Iterable[str], separator: str) -> str | None:
    """The sign of the fractions among the fields."""
    seen = {}
    for field in fields:
        for sign, form in FRACTION.items():
            if form.fullmatch(field):
                seen.setdefault(sign, field)
    if len(seen) == 2:
        raise InputError(
            f"columns are separated by {SEPARATORS[separator]}s, and numbers are written with points "
            f"({seen['.']!r}) and with commas ({seen[',']!r}); write all with the one or all with the other, "
            f"and none with a mark for thousands"
        )
    return next(iter(seen), None)


def _header(rows: Sequence[Line], width: int) -> Line | None:
    """The line of names: the first that is as long as the rows and holds no number; else the very first."""
    whole = []
    for row in rows:
        if any(is_number(field) for field in row[1]):
            if len(row[1]) == width:
                break
        elif len(row[1]) == width or (len(row[1]) == width - 1 and _ends_blank(rows)):
            whole.append(row)
    unique = [row for row in whole if len({*row[1]}) == len(row[1]) and all(row[1])]
    if whole:
        return next((row for row in unique if not are_units(row[1], whole[0][1])), whole[0])
    return None if all(is_number(field) or not field for field in rows[0][1]) else rows[0]


def _ends_blank(rows: Sequence[Line]) -> bool:
    return all(not row[-1] for _, row in rows[-max(1, len(rows) // 2) :])


def _commented(lines: Sequence[str], rows: Sequence[Line], separator: str, width: int) -> Line | None:
    """The last comment line above the rows that holds a name for each of their fields, as NumPy writes it."""
    for i in range(rows[0][0] - 1, -1, -1):
        mark = COMMENT.match(lines[i])
        names = fields_of(lines[i][mark.end() :], separator) if mark else []
        if mark and names and not names[0]:
            names[0] = mark[1]  # A column of numbers of samples is often called so.
        if len(names) == width and all(names) and not any(is_number(name) for name in names):
            return i, names
    return None


def are_units(fields: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a line below the names gives units: each field one, or a mark for none, and one at least."""
    bare = [field.strip("[]() ") for field in fields]
    units = [unit_in(text) is not None for text in bare]
    fits = all(unit or text in ("", "-", "1", "%") for text, unit in zip(bare, units, strict=True))
    return fits and any(units) and len(fields) <= len(names) and list(fields) != list(names)


def _longer(rows: Sequence[Line], names: Sequence[str]) -> bool:
    longer = sum(len(row) > len(names) and any(row[len(names) :]) for _, row in rows)
    return 2 * longer > len(rows)
