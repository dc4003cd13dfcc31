"""Columns of files that hold groups or topics: names ``group/channel``, and which clock each belongs to."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxmuscle.recordings.table import Table

CLOCK = "time"
"""Name of the column of a group's times, where the file keeps them apart from its channels."""
LONGEST = 64
"""Longest array of a row or message whose entries are columns; longer ones are pictures and the like."""
TIMES = re.compile(r"(t|time|times|timestamps?|clock|seconds)([ _\[(].*)?", re.IGNORECASE)
"""Names of a column that holds the times of those beside it."""


def grouped(
    path: Path,
    columns: Mapping[str, Any],
    units: Mapping[str, str],
    clocks: Mapping[str, str] | None = None,
) -> Table:
    """A table of columns ``group/channel``.

    Args:
        path: where they stand.
        columns: name → vector.
        units: name → unit, as far as the file has it.
        clocks: name → name of the column of its times, as far as the file says so. Else it is the column
            of its own group that is named like one and is as long.
    """
    known = dict(clocks or {})
    by_group: dict[str, list[str]] = {}
    for name in columns:
        by_group.setdefault(name.rpartition("/")[0], []).append(name)
    for names in by_group.values():
        for clock in (name for name in names if TIMES.fullmatch(name.rpartition("/")[2])):
            alike = [name for name in names if len(columns[name]) == len(columns[clock])]
            known = {**dict.fromkeys(alike, clock), **known}
    several = len({*known.values()}) > 1
    return Table(path, columns, first_row=1, units=units, clocks=known if several else {})
