"""Checkpoint of a diagnosis: every finished search and fit, so that an interrupted diagnosis goes on.

A fit is kept under a hash of all numbers that determine it and looked up before it is computed again. Floats
come back to the last bit: what follows is what an uninterrupted diagnosis computes. What takes little time
(the evidence, single predictions) and what is compiled is made again, and so is the conclusion.

The file (JSON, some kilobytes) comes into being with the first fit that is finished and is removed when the
diagnosis has ended well.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.fingerprint import ORIGINS, digest, text_hash
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.serialization import plain, restored
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.files import atomic_write, check_place, file_content
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.progress import Meter

BEGINNING = '{"jaxmuscle_checkpoint": '
"""What every checkpoint begins with; a file that begins otherwise is the user's and is left alone."""
FORMAT = 1


class NotResumed(UserWarning):
    """A checkpoint is not used; the message says why."""


def _warn(message: str) -> None:
    warnings.warn(message, NotResumed, stacklevel=6)


class Checkpoint:
    """Finished fits of one diagnosis in a file, which is written anew, whole or not at all, after each.

    Threads may share it.

    Attributes:
        place: the file; `None` where nothing is kept.
        taken_over: finished fits that were in the file when it was opened.
        recalled: how often one was looked up in place of being computed.
    """

    def __init__(self, place: Path | None, told: Callable[[str], None] = _warn) -> None:
        """Look at nothing yet; `told` gets a line where the file cannot be used."""
        self.place = place
        self.told = told
        self.taken_over = self.recalled = 0
        self._origin: dict[str, str] = {}
        self._fits: dict[str, Any] = {}
        self._written: list[str] = []
        self._lock = threading.Lock()
        self._open = False

    def open(self, made_for: Mapping[str, str]) -> None:
        """Take over what the file holds, if that is of the same diagnosis.

        Args:
            made_for: what tells this one from others (:func:`~jaxmuscle.diagnosis.fingerprint.origin`).

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
            for key, fit in found.items():
                self._keep(key, fit)
        self.taken_over = len(self._fits)

    def close(self) -> None:
        """Write nothing more: fits that are under way when a diagnosis is interrupted end later."""
        with self._lock:
            self._open = False

    def remove(self) -> None:
        """Close it and remove the file: the diagnosis is done."""
        self.close()
        if self.place is not None:
            with contextlib.suppress(OSError):
                self.place.unlink(missing_ok=True)

    def recall(
        self,
        kind: str,
        of: object,
        base: Callable[[], AbstractActuator],
        compute: Callable[[], SettledFit],
        passed_over: Callable[[], None],
    ) -> SettledFit:
        """A fit that is kept, or that is computed and kept.

        Args:
            kind, of: what is done, and all that determines its outcome.
            base: gives a model of the outcome's structure, whose values are those that are not kept.
            passed_over: called where nothing is computed.
        """
        if self.place is None:
            return compute()
        key = digest(kind, of)
        with self._lock:
            known = self._fits.get(key)
            self.recalled += known is not None
        if known is not None:
            passed_over()
            return _fit(known, base())
        found = compute()
        with self._lock:
            if self._open:
                self._keep(key, _record(found, base()))
                self._write(self.place)
        return found

    def _keep(self, key: str, fit: Any) -> None:
        if key not in self._fits:  # Two threads may have computed the same.
            self._fits[key] = fit
            self._written.append(f"{json.dumps(key)}: {json.dumps(fit, allow_nan=False)}")

    def _write(self, place: Path) -> None:
        fits = "{" + ",\n".join(self._written) + "}"
        head = f"{BEGINNING}{FORMAT},\n" + "".join(
            f"{json.dumps(name)}: {json.dumps(value)},\n"
            for name, value in (("origin", self._origin), ("sha256", text_hash(fits)))
        )
        with atomic_write(place) as (file,):
            file.write_bytes(f'{head}"fits": {fits}}}\n'.encode())


NOTHING_KEPT = Checkpoint(None)
"""Computes everything and keeps nothing."""


@contextmanager
def checkpoint_at(
    resume: str | Path | Checkpoint | None, made_for: Callable[[], Mapping[str, str]], meter: Meter
) -> Iterator[Checkpoint]:
    """The checkpoint at a place, opened for one diagnosis; removed when the block ends well.

    One that is given as such is left for the caller to remove, who may have to write the results first.

    Raises:
        InputError: `resume` is no path; what :meth:`Checkpoint.open` raises.
    """
    if not (resume is None or isinstance(resume, str | os.PathLike | Checkpoint)):
        raise InputError(f"resume: expected the path of a file, or None; got {type(resume).__name__}")
    given = isinstance(resume, Checkpoint)
    found = resume if given else Checkpoint(None if resume is None else Path(resume))
    if found.place is not None:
        found.open(made_for())
    if found.taken_over:
        meter.did(0.0, f"going on with {found.taken_over} fits that are finished")
    try:
        yield found
    finally:
        found.close()
    if not given:
        found.remove()


def _read(place: Path, made_for: Mapping[str, str]) -> tuple[dict[str, Any], str]:
    """The fits in a file, and why it cannot be used if it cannot."""
    content = file_content(place)
    if content and not content.startswith(BEGINNING.encode()):
        raise InputError(
            f"resume {place}: it is no checkpoint of a diagnosis and would be written over; name another file"
        )
    try:
        data = json.loads(content)
        if data["jaxmuscle_checkpoint"] != FORMAT:
            return {}, f"it is of {ORIGINS['version']}"
        written = content.decode().partition('"fits": ')[2].removesuffix("}\n")
        if text_hash(written) != data["sha256"]:
            return {}, "it is broken"
        differing = [said for part, said in ORIGINS.items() if data["origin"][part] != made_for[part]]
        return ({}, f"it is of {' and of '.join(differing)}") if differing else (data["fits"], "")
    except (ValueError, LookupError, TypeError, RecursionError):
        return {}, "it is broken"


def _record(fit: SettledFit, base: AbstractActuator) -> Any:
    """A fit as plain data: of its model what differs from `base`."""
    before = {path: np.asarray(entry.value) for path, entry in parameters(base).items()}
    after = {path: np.asarray(entry.value) for path, entry in parameters(fit.model).items()}
    if before.keys() != after.keys():
        raise ValueError(f"expected a model of the same structure; {before.keys() ^ after.keys()} differ")
    values = {path: new for path, new in after.items() if new.tobytes() != before[path].tobytes()}
    return plain({**{f.name: getattr(fit, f.name) for f in dataclasses.fields(fit)}, "model": values})


def _fit(record: Any, base: AbstractActuator) -> SettledFit:
    """The inverse of :func:`_record`."""
    data = restored(record)
    left = {output: [Discrepancy(**each) for each in columns] for output, columns in data["left"].items()}
    model = replace(base, data["model"]) if data["model"] else base
    return SettledFit(**{**data, "model": model, "left": left})
