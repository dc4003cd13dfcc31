"""LeRobot datasets of versions 2.x (a file for each episode) and 3.x (several in a file), through pyarrow.

An episode of a dataset is a recording: ``DATASET/episode_000003`` in both versions, or the data file or the
dataset that holds no other. Several of them are several recordings, joined with breaks where recordings are.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.readers.lerobot_layout import INFO, Dataset, dataset_at, names_of_entries, root_of
from jaxmuscle.recordings.readers.library import reading
from jaxmuscle.recordings.readers.parquet import frame_in
from jaxmuscle.recordings.table import Table

CAMERAS = ("image", "video")
"""Kinds of features that are pictures."""
CLOCK, FRAME, EPISODE = "timestamp", "frame_index", "episode_index"


def file_of(path: Path) -> Path:
    """The data file that holds what a path asks for; errors as of :func:`read`."""
    dataset = _dataset(path)
    number = dataset.asked(path)
    return path if number is None else dataset.episodes[number].file


def read(path: Path, content: bytes) -> Table:
    """The columns of an episode: ``timestamp``, ``observation.state.elbow``, ``action.0``, and so on.

    Entries of a feature go by their names in ``meta/info.json`` (``features``, ``names``) where these tell
    all of them apart, else by their numbers from 0 on. ``timestamp`` [s] begins anew with each episode; it is
    stored in single precision, and taken as ``frame_index / fps`` where it is that, rounded. Pictures are no
    columns. Versions: 2.0, 2.1 and 3.0, as ``codebase_version`` in ``meta/info.json`` has them.

    Args:
        path: what is asked for, in the dataset.
        content: of the file that holds it, as of :func:`file_of`.

    Raises:
        InputError: no such dataset or episode, several where one is expected, an episode or lists of another
            length than ``meta`` says, or pyarrow is not installed.
    """
    dataset = _dataset(path)
    kinds = {name: feature.get("dtype") for name, feature in dataset.features.items()}
    pictures = [name for name, kind in kinds.items() if kind in CAMERAS]
    number = dataset.asked(path)
    frame = frame_in(path, content, pictures, None if number is None else [(EPISODE, "==", number)])
    _check_rows(path, dataset, number, frame)
    _check_shapes(path, dataset, frame)
    with reading(path, "frames of LeRobot"):
        if {CLOCK, FRAME} <= {*frame} and dataset.frequency is not None:
            frame[CLOCK] = _clock(frame, dataset.frequency)
    names = {name: names_of_entries(feature) for name, feature in dataset.features.items()}
    table = table_of_frame(path, frame, names)
    told = {name: f"is a feature of the kind {kinds[name]!r}, which is no column" for name in pictures}
    return dataclasses.replace(table, units={CLOCK: "s"}, set_aside={**table.set_aside, **told})


def _dataset(path: Path) -> Dataset:
    root = root_of(path)
    if root is None:
        raise InputError(f"{path}: expected a LeRobot dataset, or an episode of one; there is no {INFO}")
    return dataset_at(root)


def _check_rows(path: Path, dataset: Dataset, number: int | None, frame: pd.DataFrame) -> None:
    """Raise `InputError` unless the frame is one episode, of as many rows as ``meta`` says."""
    if EPISODE not in frame:
        raise InputError(f"{path}: expected a data file of LeRobot, with a column {EPISODE!r}")
    found = frame[EPISODE].unique().tolist() if number is None else [number]
    if len(found) != 1:
        raise InputError(f"{path}: expected a file of one episode; this holds {len(found)}; {dataset.listed}")
    if found[0] not in dataset.episodes:
        raise InputError(f"{path}: the dataset has no episode {found[0]}; {dataset.listed}")
    if (rows := dataset.episodes[found[0]].rows) != len(frame):
        raise InputError(
            f"{path}: expected {rows} rows of episode {found[0]}, as meta says; its data file has "
            f"{len(frame)}. Fetch or write the dataset once more"
        )


def _check_shapes(path: Path, dataset: Dataset, frame: pd.DataFrame) -> None:
    """Raise `InputError` where the lists of a feature are not as long as ``meta`` says."""
    for name in (name for name in dataset.features if name in frame):
        shape = dataset.features[name].get("shape")
        found = {len(entry) for entry in frame[name] if isinstance(entry, np.ndarray)}
        if isinstance(shape, list) and len(shape) == 1 and any(length != shape[0] for length in found):
            lengths = " and ".join(map(str, sorted(found)))
            raise InputError(
                f"{path}: feature {name!r}: expected lists of {shape[0]} entries, as {INFO} says; the data "
                f"file has lists of {lengths}. Correct the one that is wrong"
            )


def _clock(frame: pd.DataFrame, frequency: float) -> NDArray[Any]:
    """The clock before it was rounded to single precision; one that is not the frames' as it is [s]."""
    clock, exact = frame[CLOCK].to_numpy(), frame[FRAME].to_numpy() / frequency
    rounded = clock.dtype == np.float32 and np.array_equal(exact.astype(np.float32), clock)
    return exact if rounded else clock
