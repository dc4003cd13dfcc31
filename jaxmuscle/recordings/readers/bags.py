"""Recordings of ROS: bags of ROS 1 (``.bag``) and ROS 2 (``.db3``, ``.mcap``) through rosbags, and MCAP files
of JSON messages through mcap.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.readers.groups import CLOCK, LONGEST, grouped
from jaxmuscle.recordings.readers.library import library, reading
from jaxmuscle.recordings.table import Table

LOGGED = "logged"
"""Name of the column of times at which messages were written, where they have stamps of their own."""
STAMP = "header.stamp"
PARTS = ((f"{STAMP}.sec", f"{STAMP}.nanosec"), (f"{STAMP}.sec", f"{STAMP}.nsec"))

Message = tuple[str, int, Any]
"""Topic, time at which it was written [ns], content."""


def read(path: Path, content: bytes) -> Table:
    """The numbers in the messages of a bag: ``topic/field``, ``topic/field.part``, ``topic/field[0]``.

    Entries of an array go by the texts of the field ``name`` of the same message where it has one
    (``joint_states/position[elbow]``). ``topic/time`` is the clock of a topic: the stamp in the header of its
    messages, else the time at which they were written, both in seconds since the first message of the bag.

    Raises:
        InputError: not such a file, messages that only their own programs can read, or a library that is not
            installed.
    """
    json_file = path.suffix.lower() == ".mcap" and _encodings(path, content) == {"json"}
    messages = _json_messages(path, content) if json_file else _ros_messages(path)
    topics: dict[str, tuple[list[int], list[dict[str, float]]]] = {}
    for topic, written, tree in messages:
        times, rows = topics.setdefault(topic.strip("/"), ([], []))
        times.append(written)
        rows.append(dict(_numbers(tree, "")))
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    zero = min((times[0] for times, _ in topics.values()), default=0)
    for topic, (times, rows) in topics.items():
        if any(rows):
            frame = pd.DataFrame(rows)
            of_topic = _columns(times, frame, zero)
            units.update({f"{topic}/{name}": "s" for name in (CLOCK, LOGGED) if name not in frame})
            columns.update({f"{topic}/{name}": values for name, values in of_topic.items()})
            clocks.update({f"{topic}/{name}": f"{topic}/{CLOCK}" for name in of_topic})
    return grouped(path, columns, units, clocks)


def _columns(times: list[int], frame: pd.DataFrame, zero: int) -> dict[str, Any]:
    """The columns of a topic, its clock first."""
    logged = 1e-9 * np.asarray([written - zero for written in times], dtype=float)
    found = {CLOCK: logged}
    for seconds, nanoseconds in PARTS:
        if seconds in frame and nanoseconds in frame and bool((frame[seconds] > 0).to_numpy().all()):
            whole, rest = divmod(zero, 10**9)
            stamps = (frame[seconds] - whole) + 1e-9 * (frame[nanoseconds] - rest)
            found = {CLOCK: stamps.to_numpy(dtype=float), LOGGED: logged}
    values = {str(name): frame[name].to_numpy(dtype=float) for name in frame}
    return {**found, **{name: each for name, each in values.items() if not name.startswith(STAMP)}}


def _encodings(path: Path, content: bytes) -> set[str]:
    reader = library("mcap.reader", "mcap", path)
    with reading(path, "MCAP"):
        summary = reader.make_reader(io.BytesIO(content)).get_summary()
    found = {channel.message_encoding for channel in summary.channels.values()} if summary else set()
    if not found:
        raise InputError(f"{path}: holds no messages, or was not closed; mend it with 'mcap recover'")
    if found not in ({"json"}, {"cdr"}):
        raise InputError(
            f"{path}: holds messages encoded as {', '.join(sorted(found))}; expected all as cdr (ROS 2) or "
            f"all as json. Write one of the two, or export the topics as Parquet"
        )
    return found


def _json_messages(path: Path, content: bytes) -> Iterator[Message]:
    reader = library("mcap.reader", "mcap", path)
    with reading(path, "MCAP of JSON"):
        for _, channel, message in reader.make_reader(io.BytesIO(content)).iter_messages():
            yield channel.topic, message.log_time, json.loads(message.data)


def _ros_messages(path: Path) -> Iterator[Message]:
    bags = library("rosbags.highlevel", "rosbags", path)
    types = library("rosbags.typesys", "rosbags", path)
    # Bags of ROS 2 before Iron do not hold the definitions of their messages.
    usual = types.get_typestore(types.Stores.LATEST)
    with reading(path, "a bag of ROS"), bags.AnyReader([path], default_typestore=usual) as reader:
        for connection, written, raw in reader.messages():
            yield connection.topic, written, reader.deserialize(raw, connection.msgtype)


def _numbers(node: Any, name: str) -> Iterator[tuple[str, float]]:
    """The numbers in a message and the names of their places."""
    if isinstance(node, bool | int | float | np.number | np.bool_):
        yield name, float(node)
    elif isinstance(node, Mapping) or hasattr(node, "__dataclass_fields__"):
        fields = (
            node if isinstance(node, Mapping) else {f: getattr(node, f) for f in node.__dataclass_fields__}
        )
        labels = fields.get("name")
        for field, each in fields.items():
            if not field.startswith("__"):
                inner = f"{name}.{field}" if name else field
                yield from _entries(each, inner, labels) if _is_array(each) else _numbers(each, inner)


def _is_array(node: Any) -> bool:
    return isinstance(node, list | tuple | np.ndarray)


def _entries(array: Any, name: str, labels: Any) -> Iterator[tuple[str, float]]:
    if len(array) > LONGEST:
        return
    named = _is_array(labels) and len(labels) == len(array) and all(isinstance(x, str) for x in labels)
    for i, each in enumerate(array):
        yield from _numbers(each, f"{name}[{labels[i] if named else i}]")
