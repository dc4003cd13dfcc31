"""The file in which diagnoses of blind recordings are kept, a line each; several runs may fill it at once."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

Row = dict[str, Any]
Key = tuple[int, str, int, str, str]


def key(seed: int, rig: str, effects: int, noise: str, names: tuple[str, ...] = ()) -> Key:
    """What was drawn: `names` are those that it was drawn from, none for all."""
    return seed, rig, effects, noise, " ".join(sorted(names))


def kept(path: Path) -> dict[Key, Row]:
    """Lines of the file by what was drawn; a line that was cut off is left out."""
    rows = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue  # the run was interrupted while it wrote this line: it is made again
        names = tuple(row.get("names", ()))
        rows[key(row["seed"], row["rig"], len(row["truth"]), row["noise"], names)] = row
    return rows


def keep(path: Path, row: Row) -> None:
    """Add a line; one that was cut off before it is ended first."""
    with path.open("a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        ended = not (text := file.read()) or text.endswith("\n")
        file.write(("" if ended else "\n") + json.dumps(row) + "\n")


@contextmanager
def claimed(path: Path, task: Key) -> Iterator[bool]:
    """Whether this run has the task for itself; a claim ends with the process that holds it."""
    claims = path.with_name(path.name + ".claims")
    claims.mkdir(parents=True, exist_ok=True)
    with (claims / "-".join(str(part).replace(" ", "+") for part in task)).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
