"""The way of a recording through a diagnosis, call by call: how often does it come back to a file?

A diagnosis of the sample `lift` is run, in one thread, and every call within the package is looked at that
hands on the recording or something made of it: a call one of whose arguments is, holds or closes over the
recording, a part of it, or what an earlier such call returned. Then the calls are read as one reads the code:
each place that calls, in the order in which they first did, and behind it what the called function calls
itself, where it is called for the first time. Calls that JAX makes while it traces belong to one compiled
program and are left out; so are what NumPy makes of arrays and what is read from the disk.

What is looked up and not called in the text (properties, methods like `__len__`) counts with who does it.

A stay is all that is called in one file (or folder) without leaving it, a return a stay where there was one
before: stays less files. Helpers that many call are come back to from each of them.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import functools
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import CodeType, FrameType, FunctionType, MethodType
from typing import Any

import numpy as np

import jaxmuscle as jm
from jaxmuscle import parallel

ROOT = Path(jm.__file__).parent
TRACED = ("jax", "jaxlib", "equinox")
"""Packages whose calls back into ours belong to a compiled program, or to the plumbing of a module."""
PLAIN = (str, bytes, int, float, complex, bool, type, np.generic, type(None))
"""What carries no recording, even where it was computed from one."""
DEEPEST = 4
"""How many levels of what an object holds are looked into."""


class InThisThread:
    """In place of a pool of threads: each task is done at once, where it was given."""

    def __init__(self, *_: object, **__: object) -> None:
        """Take what a pool takes."""

    def map(self, function: Callable[[Any], Any], tasks: Any) -> Iterator[Any]:
        """The results of all tasks."""
        return map(function, tasks)

    def submit(self, function: Callable[[], Any]) -> Future[Any]:
        """A task that is done."""
        done: Future[Any] = Future()
        done.set_result(function())
        return done

    def shutdown(self, **_: object) -> None:
        """Nothing is left to be done."""


def members(value: Any) -> list[Any]:
    """What an object holds, if it is one of those that carry data."""
    if isinstance(value, Mapping):
        return list(value.values())
    if isinstance(value, tuple | list):
        return list(value)
    if isinstance(value, functools.partial):
        return [value.func, *value.args, *value.keywords.values()]
    if isinstance(value, MethodType):
        return [value.__self__]
    if isinstance(value, FunctionType):
        return [cell.cell_contents for cell in value.__closure__ or () if _filled(cell)]
    if type(value).__module__.startswith("jaxmuscle"):
        return list(getattr(value, "__dict__", {}).values())
    return []


def _filled(cell: Any) -> bool:
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:  # a variable that has no value yet
        return False
    return True


class Marked:
    """The recording and all that was made of it."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._kept: dict[int, Any] = {}  # the objects too: an id may not be given to another one

    def add(self, value: Any, deepest: int = DEEPEST) -> None:
        """Mark an object and what it holds."""
        if isinstance(value, PLAIN) or id(value) in self._kept:
            return
        if not isinstance(value, FunctionType | MethodType):
            self._kept[id(value)] = value
        if deepest:
            for member in members(value):
                self.add(member, deepest - 1)

    def carried_by(self, value: Any, deepest: int = 2) -> bool:
        """Whether it is marked, or holds what is."""
        if isinstance(value, PLAIN):
            return False
        if id(value) in self._kept:
            return True
        return deepest > 0 and any(self.carried_by(member, deepest - 1) for member in members(value))


class Walk:
    """The calls of a run that hand on a recording.

    Attributes:
        calls: code of a function → (line that calls, code that is called), in the order of time.
    """

    def __init__(self, recording: object) -> None:
        """Begin with a recording that is already read."""
        self.first = jm.diagnose.__code__
        self.calls: dict[CodeType, dict[tuple[int, CodeType], None]] = collections.defaultdict(dict)
        self.marked = Marked()
        self.marked.add(recording)
        self._ours: dict[str, str | None] = {}
        self._carrying: set[FrameType] = set()

    def __call__(self, frame: FrameType, event: str, value: object) -> None:
        """What `sys.setprofile` calls."""
        if event == "call" and self.place(frame.f_code) is not None and not _looked_up(frame):
            caller = self._caller(frame)
            if caller is not None and self._carries(frame):
                self._carrying.add(frame)
                self.calls[caller.f_code][(caller.f_lineno, frame.f_code)] = None
        elif event == "return" and frame in self._carrying:
            self._carrying.discard(frame)
            self.marked.add(value)

    def place(self, code: CodeType) -> str | None:
        """The file of a function, below the package; `None` outside of it."""
        name = code.co_filename
        if name not in self._ours:
            inside = name.startswith(str(ROOT))
            self._ours[name] = str(Path(name).relative_to(ROOT)) if inside else None
        return self._ours[name]

    def _caller(self, frame: FrameType) -> FrameType | None:
        """The function of the package that called, itself or through a library; `None` if JAX did."""
        above = frame.f_back
        while above is not None and self.place(above.f_code) is None:
            if above.f_globals.get("__name__", "").split(".")[0] in TRACED:
                return None
            above = above.f_back
        while above is not None and _looked_up(above):
            above = above.f_back
        return above if above in self._carrying or self._is_first(above) else None

    def _is_first(self, frame: FrameType | None) -> bool:
        return frame is not None and frame.f_code is self.first

    def _carries(self, frame: FrameType) -> bool:
        code = frame.f_code
        count = code.co_argcount + code.co_kwonlyargcount + bool(code.co_flags & 4) + bool(code.co_flags & 8)
        own = frame.f_locals
        names = (*code.co_varnames[:count], *code.co_freevars)
        return any(self.marked.carried_by(own[name]) for name in names if name in own)

    def entered(self) -> Iterator[CodeType]:
        """Every function that is entered, as the code is read."""
        passed: set[CodeType] = set()

        def enter(code: CodeType) -> Iterator[CodeType]:
            yield code
            if code not in passed:
                passed.add(code)
                for _, called in self.calls[code]:
                    yield from enter(called)

        return enter(self.first)


def _looked_up(frame: FrameType) -> bool:
    """Whether the function is a property, or one that Python calls where none stands in the text."""
    name, owner = frame.f_code.co_name, frame.f_locals.get("self")
    if name.startswith("__"):
        return name != "__init__"
    return isinstance(inspect.getattr_static(type(owner), name, None), property | functools.cached_property)


@dataclasses.dataclass(frozen=True)
class Stay:
    """All that is called in one place without leaving it."""

    place: str
    visit: int
    functions: list[str]


def stays(walk: Walk, place: Callable[[CodeType], str]) -> list[Stay]:
    """The stays of a walk, one after the other."""
    found: list[Stay] = []
    visits: collections.Counter[str] = collections.Counter()
    for code in walk.entered():
        where = place(code)
        if not found or found[-1].place != where:
            visits[where] += 1
            found.append(Stay(where, visits[where], []))
        found[-1].functions.append(code.co_qualname)
    return found


def walked() -> Walk:
    """The walk of the sample `lift`."""
    recording = jm.read(jm.sample("lift"))
    parallel.ThreadPoolExecutor = InThisThread  # pyright: ignore[reportAttributeAccessIssue]
    walk = Walk(recording)

    def run() -> None:
        sys.setprofile(walk)
        jm.diagnose(recording)

    # Called from another thread than the main one, a diagnosis does all its work there.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(run).result()
    return walk


def told(found: list[Stay], what: str) -> str:
    """A line of figures, and who is come back to most."""
    visits = collections.Counter(stay.place for stay in found)
    most = ", ".join(f"{place} {count - 1}" for place, count in visits.most_common(12) if count > 1)
    return (
        f"by {what}: {len(found)} stays in {len(visits)} {what}s, {len(found) - len(visits)} returns\n"
        f"  returns to {most}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--list", action="store_true", help="every stay of the walk by files, in order")
    wanted = parser.parse_args()
    walk = walked()
    by_file = stays(walk, lambda code: walk.place(code) or "")
    by_folder = stays(walk, lambda code: str(Path(walk.place(code) or "").parent))
    if wanted.list:
        for number, stay in enumerate(by_file, 1):
            again = f"(visit {stay.visit})" if stay.visit > 1 else ""
            print(f"{number:4d} {stay.place:42s} {again:10s} {', '.join(dict.fromkeys(stay.functions))}")
    print(told(by_file, "file"))
    print(told(by_folder, "folder"))
