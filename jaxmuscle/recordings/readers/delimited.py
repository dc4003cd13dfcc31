"""Delimited texts: ``.csv``, ``.tsv`` and ``.txt`` of any dialect, compressed by gzip or not."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.dialect import COMMA, SEPARATORS, Dialect, dialect_of
from jaxmuscle.recordings.table import Table

LINES_SEEN, BYTES_SEEN = 200, 2**22
"""Lines by which the dialect is told, and where they end at the latest."""
COMMENT_BELOW = re.compile(rb"[\r\n][ \t]*(?:#|%(?=[\s%]|$)|//)")
MOSTLY_LATIN = 0.5
"""Share of characters of a European text, by which UTF-16 is told from bytes that are no text."""


def read(path: Path, content: bytes) -> Table:
    """The table in a delimited text.

    Separated by commas, semicolons, tabs, bars or blanks, with decimal points or commas, names in the first
    line that is no comment (``#``, ``%``, ``//``) and no remark of another length; units may stand below
    it. A text in UTF-8, in UTF-16 with its mark, or in Windows-1252.

    Raises:
        InputError: no such text, or one that can be understood in two ways.
    """
    content = _utf8(path, _unpacked(path, content))
    try:
        dialect = dialect_of(_first_lines(content))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    comments = _comments(content, dialect.first)
    try:
        frame = _frame(content, dialect, comments)
    except (pd.errors.EmptyDataError, pd.errors.ParserError) as error:
        reason = str(error).strip().removeprefix("Error tokenizing data. C error: ")
        kind = f"a {SEPARATORS[dialect.separator]}-separated table"
        raise InputError(f"{path}: cannot be read as {kind}: {reason}") from error
    names = _names(path, dialect, frame)
    frame = frame.iloc[:, : len(names)].set_axis(names, axis=1)
    filled = np.flatnonzero(frame.notna().any(axis=1).to_numpy())
    frame = frame.iloc[: filled[-1] + 1] if filled.size else frame.iloc[:0]
    units = dict(zip(names, dialect.units, strict=False)) if dialect.units else {}
    return Table(
        path,
        {name: frame[name] for name in names},
        first_row=dialect.first + 1,
        rows=_rows(dialect.first, comments, len(frame)),
        units={name: unit.strip("[]() ") for name, unit in units.items() if unit.strip("[]()- ")},
    )


def _first_lines(content: bytes) -> list[str]:
    """The first lines, of which the last one is left out where it may be cut."""
    lines = re.split(r"\r\n|\n|\r", content[:BYTES_SEEN].decode("utf-8", "ignore"))
    whole = lines[:-1] if len(content) > BYTES_SEEN and len(lines) > 1 else lines
    return whole[:LINES_SEEN]


def _unpacked(path: Path, content: bytes) -> bytes:
    if path.suffix.lower() != ".gz":
        return content
    try:
        return gzip.decompress(content)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be unpacked by gzip: {error}; compress it once more") from error


def _utf8(path: Path, content: bytes) -> bytes:
    """The text in UTF-8 without its mark, from what laboratory software on Windows writes too."""
    begin, decoder = 0, codecs.getincrementaldecoder("utf-8")()
    try:
        # Part by part: the whole text beside its bytes would take the memory twice.
        for begin in range(0, len(content) + 1, BYTES_SEEN):
            decoder.decode(content[begin : begin + BYTES_SEEN], final=begin + BYTES_SEEN > len(content))
        return content.removeprefix(b"\xef\xbb\xbf")
    except UnicodeDecodeError as error:
        wrong, at = error, begin - len(decoder.getstate()[0]) + error.start
    marked = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    if not marked and b"\x00" in content:
        raise InputError(f"{path}: not a text in UTF-8 (byte {at}); save it as UTF-8") from wrong
    # What cannot be decoded is marked by a character that no encoding of Windows has.
    text = content.decode("utf-16" if marked else "cp1252", errors="replace")
    latin = sum(character < "\u0100" for character in text[:1000]) > MOSTLY_LATIN * len(text[:1000])
    if latin and "\ufffd" not in text:
        return text.encode("utf-8")
    raise InputError(f"{path}: not a text in UTF-8 (byte {at}); save it as UTF-8") from wrong


def _comments(content: bytes, first: int) -> list[int]:
    """Comment lines below the line `first`, counted from 0."""
    if not any(mark in content for mark in (b"#", b"%", b"//")):
        return []
    newline, found, line, last = (b"\n" if b"\n" in content else b"\r"), [], 0, 0
    for match in COMMENT_BELOW.finditer(content):
        line, last = line + content.count(newline, last, match.start() + 1), match.start() + 1
        if line > first:
            found.append(line)
    return found


def _frame(content: bytes, dialect: Dialect, comments: list[int]) -> pd.DataFrame:
    decimal = dialect.decimal or ("," if _has_decimal_commas(content, dialect) else ".")
    above = [line for line in range(dialect.first) if line != dialect.header]
    options: dict[str, Any] = {"header": 0}
    if dialect.commented:
        above, options = list(range(dialect.first)), {"header": None}
    if dialect.trailing:
        options["index_col"] = False
    # Blank lines stay rows, so that the numbers of rows are those of the file.
    frame = pd.read_csv(
        io.BytesIO(content),
        sep=r"\s+" if dialect.separator == " " else dialect.separator,
        decimal=decimal,
        encoding="utf-8",
        skiprows=[*above, *comments],
        skipinitialspace=dialect.separator != "\t",
        skip_blank_lines=False,
        low_memory=False,
        **options,
    )
    return frame if decimal == "." else frame.apply(_with_points)


def _with_points(column: pd.Series) -> pd.Series:
    """A column of texts, since one of them is no number, with points in those that are: they can be told."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    return column.map(lambda x: x.replace(",", ".") if isinstance(x, str) and COMMA.fullmatch(x) else x)


def _has_decimal_commas(content: bytes, dialect: Dialect) -> bool:
    """Whether numbers with commas come later, where the first lines hold integers only."""
    return dialect.separator != "," and re.search(rb"\d,\d", content) is not None


def _names(path: Path, dialect: Dialect, frame: pd.DataFrame) -> list[str]:
    names, row = list(dialect.names), dialect.header + 1
    if not isinstance(frame.index, pd.RangeIndex) or len(frame.columns) != len(names):
        raise InputError(
            f"{path}: rows hold more fields than row {row} holds names ({len(names)}); mend row {row}, or "
            f"write points in the numbers if they have commas"
        )
    if names and not names[-1] and frame.iloc[:, -1].isna().all():
        names.pop()
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{path}, row {row}: several columns named {', '.join(map(repr, twice))}; rename them"
        )
    return names


def _rows(first: int, comments: list[int], samples: int) -> NDArray[np.intp] | None:
    """Number in the file of every sample's row, where comment lines stand between them."""
    if not comments:
        return None
    lines = np.setdiff1d(np.arange(first, first + samples + len(comments)), comments)
    return lines[:samples] + 1
