"""Files: whether one is there, what it holds, and writing it whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import platform
import re
import secrets
import shutil
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxmuscle.errors import InputError, nearest

REMEDIES = {
    errno.ENOSPC: "free some space, or name a place on another disk",
    errno.EDQUOT: "free some of your quota, or name a place on another disk",
    errno.EFBIG: "the system limits the size of files (ulimit -f); name a place on another disk",
    errno.EROFS: "name a place that can be written",
    errno.EACCES: "name a place that can be written",
    errno.EPERM: "name a place that can be written",
    errno.ENOENT: "make its folder, or name another",
    errno.ENAMETOOLONG: "name a shorter one",
}
"""Fault of the system → what to do, for the end of a message."""
HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
"""Mark of this machine: a folder may be shared, and a process has a number on one machine only."""
UNFINISHED = re.compile(r"\..*\.([0-9a-f]{8})-(\d+)-[0-9a-f]{8}(\.[^.]*)?")
"""Names of files and folders that are being written, with machine and process that write them."""
MARK = re.compile(r"[0-9a-f]{8}(\.[^.]*)?$")
"""The end of such a name, by which the folders of one process differ."""

_unfinished: dict[Path, Path] = {}
"""What this process is writing → its folder, which goes when that is done or given up. Without a folder of
its own a file that :func:`abandon` has removed would come back where its writer, in another thread, only then
opens it."""
_renaming = threading.RLock()
"""Held while finished files take their places and while what is unfinished is removed, and for ever once
:func:`abandon` was called."""


@functools.cache
def package_hash() -> str:
    """A hash of the source of the package as it lies on the disk."""
    found = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        found.update(file.read_bytes())
    return found.hexdigest()


@contextmanager
def atomic_write(*places: Path) -> Iterator[tuple[Path, ...]]:
    """Write files whole or not at all: new ones beside `places`, renamed over them when all are full.

    The block fills the paths that it is given, in the order of `places`; they have the same endings. When it
    fails, whatever stood at `places` stays as it was, and nothing is left beside it. A new file gets the mode
    that the umask asks for, one that is replaced keeps its mode, as with `open`; a link is followed. What a
    process that was killed has left beside `places` is removed.

    Raises:
        InputError: the system refuses (no folder, no permission, no space).
    """
    targets = [Path(os.path.realpath(place)) for place in places]
    waiting: list[Path] = []
    with told_where(*places):
        if set(targets) <= _unfinished.keys():
            yield tuple(targets)  # A block around this one has them take their places.
            return
        try:
            for target in targets:
                if target.is_dir():
                    raise IsADirectoryError(errno.EISDIR, "it is a folder")
                waiting.append(_opened_beside(target))
            yield tuple(waiting)
            for unfinished in waiting:
                _to_disk(unfinished)
            with _renaming:
                for unfinished, target in zip(waiting, targets, strict=True):
                    unfinished.replace(target)
        finally:
            _remove(waiting)


@contextmanager
def atomic_folder(folder: Path, names: Iterable[str]) -> Iterator[tuple[Path, ...]]:
    """Write files of a folder: all of them, or none, as :func:`atomic_write` does.

    A folder that is not there comes into being in one step with all that it holds, so that not even a
    process that is killed leaves some of the files. In one that is there they are renamed one after the
    other.

    Raises:
        InputError: the system refuses.
    """
    names = tuple(names)
    if folder.exists():
        with atomic_write(*(folder / name for name in names)) as files:
            yield files
        return
    with new_folder(folder) as inner:
        files = tuple(inner / name for name in names)
        yield files
        for file in files:
            _to_disk(file)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Make a folder that is not there, or is empty, with all that the block writes into the path it is given.

    Raises:
        InputError: the system refuses.
    """
    place = folder.absolute()
    with told_where(folder):
        # What is renamed is the uppermost folder that is not there, with those below it.
        top = next((p for p in (place, *place.parents) if p.parent.exists()), place)
        unfinished = _beside(top)
        inner = unfinished / place.relative_to(top)
        try:
            with _renaming:
                _unfinished[unfinished] = unfinished
                inner.mkdir(parents=True)
            yield inner
            with _renaming:
                unfinished.rename(top)
        finally:
            _remove([unfinished])


def abandon() -> None:
    """Remove what this process has not finished, for its end: from here on it finishes nothing more.

    Files that are taking their places just now do so first, and what another thread is removing is gone.
    """
    _renaming.acquire()
    _remove(list(_unfinished))


def check_place(file: Path, option: str) -> None:
    """Raise `InputError` when no file can be written at `file`: better now than after an hour of work.

    Args:
        file: where it will be written.
        option: how the user named it, for the message.
    """
    folder = file.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{option} {file}: there is no folder {str(folder)!r}; make it, or name another")
    if file.is_dir():
        raise InputError(f"{option} {file}: expected a file; it is a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{option} {file}: no permission to write into {str(folder)!r}; name another folder")


@contextmanager
def told_where(*places: object) -> Iterator[None]:
    """Turn a refusal of the system into one message: what cannot be written, where, and what to do."""
    try:
        yield
    except OSError as error:
        names = ", ".join(repr(str(place)) for place in places)
        remedy = f"; {REMEDIES[error.errno]}" if error.errno in REMEDIES else ""
        raise InputError(f"cannot write {names}: {error.strerror or error}{remedy}") from error


def _opened_beside(target: Path) -> Path:
    """A new empty file in a new folder beside `target`, with the mode that `target` has or would get."""
    folder = _beside(target)
    unfinished = folder / target.name
    with _renaming:
        _unfinished[unfinished] = folder
        try:
            folder.mkdir()
            unfinished.touch(exist_ok=False)
            if target.exists():
                unfinished.chmod(target.stat().st_mode & 0o777)
        except OSError:
            _remove([unfinished])
            raise
    return unfinished


def _beside(target: Path) -> Path:
    """A name that nothing has, in the folder of `target`; what dead processes have left there goes."""
    stem = target.stem[:100]
    with contextlib.suppress(OSError):
        for left in target.parent.glob(f".{_literal(stem)}.*-*{_literal(target.suffix)}"):
            found = UNFINISHED.fullmatch(left.name)
            if found and found[1] == HOST and not _is_alive(int(found[2])):
                _remove([left])
    return target.with_name(f".{stem}.{HOST}-{os.getpid()}-{secrets.token_hex(4)}{target.suffix}")


def _literal(text: str) -> str:
    """A text as a pattern of `glob` that fits it alone."""
    return re.sub(r"([\[*?])", r"[\1]", text)


def _is_alive(process: int) -> bool:
    """Whether a process runs, on systems that can be asked without harm; elsewhere every one does."""
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _to_disk(file: Path) -> None:
    """Have the system write what it holds back: a full disk is told now, not after the renaming."""
    with file.open("rb+") as opened:
        os.fsync(opened.fileno())


def _remove(paths: Iterable[Path]) -> None:
    """Remove what is being written, with its folder, before :func:`abandon` ends the process."""
    with _renaming:
        for path in paths:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):  # Its folder may be a file.
                _remove_folder(_unfinished.pop(path, path))


def _remove_folder(folder: Path) -> None:
    """Rename a folder, then remove it: who still writes there, in another thread, finds it gone from one
    moment to the next, and puts nothing new into what is being removed.
    """
    away = MARK.sub(lambda mark: f"{secrets.token_hex(4)}{mark[1] or ''}", folder.name)
    with contextlib.suppress(PermissionError):  # Not every system renames a folder with open files.
        folder = folder.rename(folder.with_name(away))
    shutil.rmtree(folder, ignore_errors=True) if folder.is_dir() else folder.unlink()


def existing_file(path: Path, kind: str, suffixes: tuple[str, ...]) -> Path:
    """`path` when it is a file.

    Args:
        path: where the file should be.
        kind: what it is, in the words of the message ("card", "recording").
        suffixes: endings of such files; those in the same folder are listed in the message.

    Raises:
        InputError: there is no such file.
    """
    if path.is_file():
        return path
    endings = " or ".join(suffixes) if len(suffixes) < 3 else f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"
    if path.is_dir():
        raise InputError(f"{path} is a folder; expected a {kind} ({endings})")
    if not path.parent.is_dir():
        raise InputError(f"no {kind} {str(path)!r}: there is no folder {str(path.parent)!r}")
    others = sorted(file.name for file in path.parent.iterdir() if file.name.lower().endswith(suffixes))
    hint = nearest(path.name, others[:20]) if others else f"; the folder holds no {endings}"
    raise InputError(f"no {kind} {path.name!r} in {str(path.parent.resolve())!r}{hint}")


def file_content(path: Path) -> bytes:
    """The bytes of a file; `InputError` when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
