"""Layout of LeRobot datasets: what ``meta`` says of features, of episodes and of the files that hold them."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.errors import InputError
from jaxmuscle.files import file_content
from jaxmuscle.recordings.readers.library import library, reading

INFO = Path("meta", "info.json")
EPISODE = re.compile(r"episode_(\d{1,9})")
"""Name by which an episode of a dataset is asked for."""
VERSION = re.compile(r"v?[23]\.\d.*")
FIELD = re.compile(r"\{(\w+)(?::0?(\d{1,2})d)?\}")
"""Place of a number in the pattern of a path."""
PLACES = ("data/chunk_index", "data/file_index")
"""Columns of ``meta/episodes`` that say in which file an episode stands."""
LISTED = 20
"""Episodes that a message lists at most."""


@dataclasses.dataclass(frozen=True)
class Episode:
    """An episode of a dataset: the file that holds it, and how many rows of it."""

    file: Path
    rows: int


@dataclasses.dataclass(frozen=True)
class Dataset:
    """What ``meta`` says of a dataset.

    Attributes:
        root: its folder.
        frequency: frames per second, where it is said.
        features: name → entry with "dtype", "shape" and "names".
        episodes: number → episode.
    """

    root: Path
    frequency: float | None
    features: Mapping[str, Mapping[str, Any]]
    episodes: Mapping[int, Episode]

    @property
    def listed(self) -> str:
        """Its episodes and how one is asked for, as the end of a message."""
        numbers = sorted(self.episodes)
        if not numbers:
            return "it has none"
        whole = len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1))
        cut = [*map(str, numbers[:LISTED]), *([f"… ({len(numbers)} in all)"] if numbers[LISTED:] else [])]
        span = f"{numbers[0]} to {numbers[-1]}" if whole else ", ".join(cut)
        return (
            f"it has {span}. Write {self.root / f'episode_{numbers[0]:06d}'}, and several as several tables"
        )

    def asked(self, path: Path) -> int | None:
        """The number of the episode that a path asks for; `None` of a data file, which may hold one.

        Raises:
            InputError: there is no such episode; a folder of several, or not by its name.
        """
        named = EPISODE.fullmatch(path.name)
        if named is not None:
            if (number := int(named[1])) in self.episodes:
                return number
            raise InputError(f"{path}: the dataset has no episode {number}; {self.listed}")
        if path.suffix.lower() == ".parquet":
            return None
        # A folder that is not named has no name for its card.
        if len(self.episodes) == 1 and path.name not in ("", ".."):
            return next(iter(self.episodes))
        raise InputError(f"{path}: expected one episode of the dataset; {self.listed}")


def root_of(path: Path) -> Path | None:
    """The folder of the dataset of which a path is all, an episode or a data file; `None` of other paths."""
    folder = path.absolute().parent
    if EPISODE.fullmatch(path.name):
        root = path.parent
    elif path.suffix.lower() == ".parquet" and folder.name.startswith("chunk-"):
        root = folder.parent.parent
    else:
        root = path
    return root if (root / INFO).is_file() else None


def dataset_at(root: Path) -> Dataset:
    """What ``meta`` says of the dataset in a folder.

    Raises:
        InputError: files of ``meta`` that are missing or no such files; a dataset of another version than
            2.x or 3.x; pyarrow, which lists the episodes of 3.x, is not installed.
    """
    file = root / INFO
    with reading(file, "JSON"):
        info = json.loads(file_content(file))
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise InputError(f"{file}: expected what LeRobot writes, with an entry 'features'")
    version = str(info.get("codebase_version"))
    if not VERSION.fullmatch(version):
        raise InputError(
            f"{file}: expected a dataset of version 2.x or 3.x; got {version[:20]!r} as codebase_version. "
            f"Convert it with LeRobot"
        )
    features = {name: entry for name, entry in info["features"].items() if isinstance(entry, dict)}
    listed = _of_lines(root, info) if version.lstrip("v").startswith("2") else _of_tables(root)
    episodes = {
        number: Episode(root / _filled(file, info.get("data_path"), places), rows)
        for number, rows, places in listed
    }
    frequency: Any = info.get("fps")
    known = isinstance(frequency, int | float) and not isinstance(frequency, bool) and 0 < frequency < 1e9
    return Dataset(root, float(frequency) if known else None, features, episodes)


_Listed = tuple[int, int, dict[str, int]]
"""Number of an episode, its rows, and the numbers that stand in the path of its file."""


def _of_lines(root: Path, info: Mapping[str, Any]) -> Iterator[_Listed]:
    """The episodes of version 2.x, a line of JSON each."""
    file, chunk = root / "meta" / "episodes.jsonl", info.get("chunks_size")
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise InputError(f"{root / INFO}: expected the number of episodes in a chunk as chunks_size")
    with reading(file, "lines of JSON"):
        entries = [json.loads(line) for line in file_content(file).splitlines() if line.strip()]
        numbers = [(int(entry["episode_index"]), int(entry["length"])) for entry in entries]
    for number, rows in numbers:
        yield number, rows, {"episode_index": number, "episode_chunk": number // chunk}


def _of_tables(root: Path) -> Iterator[_Listed]:
    """The episodes of version 3.x, a row of a table each."""
    folder = root / "meta" / "episodes"
    library("pyarrow", "pyarrow", root)
    files = sorted(folder.glob("*/*.parquet"))
    if not files:
        raise InputError(f"{folder}: holds no table of the episodes (chunk-000/file-000.parquet)")
    for file in files:
        with reading(file, "a table of episodes"):
            # Beside these the table holds hundreds of columns of statistics.
            frame = pd.read_parquet(file, columns=["episode_index", "length", *PLACES])
            whole = frame.to_numpy(dtype=np.int64).tolist()
        for number, rows, chunk, part in whole:
            yield number, rows, {"chunk_index": chunk, "file_index": part}


def _filled(file: Path, pattern: Any, numbers: Mapping[str, int]) -> str:
    """The path of a data file below the root of its dataset."""

    def digits(field: re.Match[str]) -> str:
        return str(numbers[field[1]]).zfill(int(field[2] or 0)) if field[1] in numbers else field[0]

    path = FIELD.sub(digits, pattern) if isinstance(pattern, str) else "{"
    if "{" in path or Path(path).is_absolute() or ".." in Path(path).parts:
        known = " and ".join(f"{{{name}}}" for name in numbers)
        raise InputError(f"{file}: expected data_path, a path of data files with {known}; got {pattern!r}")
    return path


def names_of_entries(feature: Mapping[str, Any]) -> Sequence[str]:
    """The names of the entries of a feature, in order; none where they are not told apart by name.

    LeRobot has them as a list, as lists by kind, ``{"motors": […]}``, or as name → place.
    """
    said: Any = feature.get("names")
    if isinstance(said, dict) and all(isinstance(place, int) for place in said.values()):
        said = sorted(said, key=said.__getitem__)
    elif isinstance(said, dict):
        said = [name for part in said.values() if isinstance(part, list) for name in part]
    names = said if isinstance(said, list) else []
    told = all(isinstance(name, str) and name for name in names) and len({*names}) == len(names)
    return names if told else ()
