"""Checkpoint of a diagnosis or a fit: what is finished, so that an interrupted one goes on.

A diagnosis keeps every search and fit, a fit every evaluation of its cost and derivatives. Each is kept under
a hash of all numbers that determine it and looked up before it is computed again. Floats come back to the
last bit: what follows is what an uninterrupted run computes. What takes little time (the evidence, single
predictions) and what is compiled is made again, and so is the conclusion.

The file (JSON; of a diagnosis some kilobytes, of a fit k² numbers an evaluation with k parameters) comes into
being with the first that is finished and is removed when all has ended well.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from jaxmuscle.errors import InputError
from jaxmuscle.estimation.fingerprint import ORIGINS, digest, text_hash
from jaxmuscle.files import atomic_write, check_place, file_content

BEGINNING = '{"jaxmuscle_checkpoint": '
"""What every checkpoint begins with; a file that begins otherwise is the user's and is left alone."""
FORMAT = 2
Outcome = TypeVar("Outcome")


class NotResumed(UserWarning):
    """A checkpoint is not used; the message says why."""


def _warn(message: str) -> None:
    warnings.warn(message, NotResumed, stacklevel=6)


class Checkpoint:
    """What is finished of one diagnosis or fit, in memory and in a file, which is written anew, whole or not
    at all.

    Threads may share it.

    Attributes:
        place: the file; `None` where it is kept in memory alone.
        keeps: whether anything is kept.
        taken_over: outcomes that were in the file when it was opened.
        recalled: how often one was looked up in place of being computed.
    """

    def __init__(self, place: Path | None, told: Callable[[str], None] = _warn, keeps: bool = True) -> None:
        """Look at nothing yet; `told` gets a line where the file cannot be used."""
        self.place, self.keeps = place, keeps
        self.told = told
        self.taken_over = self.recalled = 0
        self._origin: dict[str, str] = {}
        self._kept: dict[str, Any] = {}
        self._lines: list[str] = []
        self._remembered: dict[str, Any] = {}
        self._last, self._behind = -float("inf"), False
        self._lock = threading.Lock()
        self._open = False

    def open(self, made_for: Mapping[str, str]) -> None:
        """Take over what the file holds, if that is of the same diagnosis or fit.

        Args:
            made_for: what tells this one from others (:func:`~jaxmuscle.estimation.fingerprint.origin`).

        Raises:
            InputError: the place is no file that can be written, or holds something else.
        """
        if self.place is None:
            return
        check_place(self.place, "resume")
        self._origin, self._open = dict(made_for), True
        if self.place.exists():
            found, reason = _read(self.place, self._origin)
            if reason:
                self.told(f"{self.place}: {reason}; it is not used, and everything is computed anew")
            for key, record in found.items():
                self._keep(key, record)
        self.taken_over = len(self._kept)

    def close(self) -> None:
        """Write what is not yet written, and nothing more: what is under way then ends later."""
        with self._lock:
            if self._open and self._behind and self.place is not None:
                self._write(self.place)
            self._open = False

    def remove(self) -> None:
        """Remove the file: all is done."""
        with self._lock:
            self._open = False
        if self.place is not None:
            with contextlib.suppress(OSError):
                self.place.unlink(missing_ok=True)

    def recall(
        self,
        kind: str,
        of: Sequence[object],
        compute: Callable[[list[int]], Sequence[Outcome]],
        record: Callable[[Outcome], Any],
        restored: Callable[[Any], Outcome],
        every: float = 0.0,
    ) -> list[Outcome]:
        """Outcomes that are kept, or that are computed and kept.

        Args:
            kind, of: what is done, and of each outcome all that determines it.
            compute: gives the outcomes of those that are not kept, by their numbers; not called without any.
            record, restored: an outcome as plain data of finite numbers, and back.
            every: seconds between two writings of the file; what is kept in between may be lost by a kill.
        """
        if not self.keeps:
            return list(compute(list(range(len(of)))))
        keys = [digest(kind, each) for each in of]
        with self._lock:
            found = {i: self._kept[key] for i, key in enumerate(keys) if key in self._kept}
            self.recalled += len(found)
        new = [i for i in range(len(of)) if i not in found]
        computed = dict(zip(new, compute(new), strict=True)) if new else {}
        with self._lock:
            for i, outcome in computed.items():
                self._keep(keys[i], record(outcome))
            if self._open and new and self.place is not None:
                self._behind = True
                if time.monotonic() - self._last >= every:
                    self._write(self.place)
        return [computed[i] if i in computed else restored(found[i]) for i in range(len(of))]

    def remember(self, kind: str, of: object, compute: Callable[[], Outcome]) -> Outcome:
        """An outcome that is kept in memory alone, because it is quickly made again.

        Args:
            kind, of: what is done, and all that determines the outcome.
        """
        if not self.keeps:
            return compute()
        key = digest(kind, of)
        if key not in self._remembered:
            self._remembered[key] = compute()
        return self._remembered[key]

    def _keep(self, key: str, record: Any) -> None:
        if key not in self._kept:  # Two threads may have computed the same.
            self._kept[key] = record
            if self.place is not None:
                self._lines.append(f"{json.dumps(key)}: {json.dumps(record, allow_nan=False)}")

    def _write(self, place: Path) -> None:
        kept = "{" + ",\n".join(self._lines) + "}"
        head = f"{BEGINNING}{FORMAT},\n" + "".join(
            f"{json.dumps(name)}: {json.dumps(value)},\n"
            for name, value in (("origin", self._origin), ("sha256", text_hash(kept)))
        )
        with atomic_write(place) as (file,):
            file.write_bytes(f'{head}"kept": {kept}}}\n'.encode())
        self._last, self._behind = time.monotonic(), False


NOTHING_KEPT = Checkpoint(None, keeps=False)
"""Computes everything and keeps nothing."""


@contextmanager
def checkpoint_at(
    resume: str | Path | Checkpoint | None,
    made_for: Callable[[], Mapping[str, str]],
    tell: Callable[[str], None],
    what: str,
) -> Iterator[Checkpoint]:
    """The checkpoint at a place, opened for one diagnosis or fit; removed when the block ends well.

    One that is given as such is left for the caller to remove, who may have to write the results first.

    Args:
        what: outcomes that it keeps, for the message to `tell`.

    Raises:
        InputError: `resume` is no path; what :meth:`Checkpoint.open` raises.
    """
    if not (resume is None or isinstance(resume, str | os.PathLike | Checkpoint)):
        raise InputError(f"resume: expected the path of a file, or None; got {type(resume).__name__}")
    given = isinstance(resume, Checkpoint)
    found = resume if given else NOTHING_KEPT if resume is None else Checkpoint(Path(resume))
    if found.place is not None:
        found.open(made_for())
    if found.taken_over:
        tell(f"going on with {found.taken_over} {what} that are finished")
    try:
        yield found
    finally:
        found.close()
    if not given:
        found.remove()


def _read(place: Path, made_for: Mapping[str, str]) -> tuple[dict[str, Any], str]:
    """What a file has kept, and why it cannot be used if it cannot."""
    content = file_content(place)
    if content and not content.startswith(BEGINNING.encode()):
        raise InputError(f"resume {place}: it is no checkpoint and would be written over; name another file")
    try:
        data = json.loads(content)
        if data["jaxmuscle_checkpoint"] != FORMAT:
            return {}, f"it is of {ORIGINS['version']}"
        written = content.decode().partition('"kept": ')[2].removesuffix("}\n")
        if text_hash(written) != data["sha256"]:
            return {}, "it is broken"
        differing = [said for part, said in ORIGINS.items() if data["origin"][part] != made_for[part]]
        return ({}, f"it is of {' and of '.join(differing)}") if differing else (data["kept"], "")
    except (ValueError, LookupError, TypeError, RecursionError):
        return {}, "it is broken"
