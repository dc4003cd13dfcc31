"""Files: whether one is there, what it holds, and writing it whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxmuscle.errors import InputError, nearest


@contextmanager
def atomic_write(*places: Path) -> Iterator[tuple[Path, ...]]:
    """Write files whole or not at all: new ones beside `places`, renamed over them when all are full.

    The block fills the paths that it is given, in the order of `places`; they have the same endings. When it
    fails, whatever stood at `places` stays as it was, and nothing is left beside it. A new file gets the mode
    that the umask asks for, one that is replaced keeps its mode, as with `open`; a link is followed.

    Raises:
        InputError: the system refuses (no folder, no permission, no space).
    """
    targets = [Path(os.path.realpath(place)) for place in places]
    waiting: list[Path] = []
    try:
        for target in targets:
            if target.is_dir():
                raise IsADirectoryError(0, "it is a folder")
            waiting.append(_opened_beside(target))
        yield tuple(waiting)
        for unfinished, target in zip(waiting, targets, strict=True):
            unfinished.replace(target)
    except OSError as error:
        names = ", ".join(repr(str(place)) for place in places)
        raise InputError(f"cannot write {names}: {error.strerror or error}") from error
    finally:
        for unfinished in waiting:
            unfinished.unlink(missing_ok=True)


def _opened_beside(target: Path) -> Path:
    """A new empty file in the folder of `target`, with the mode that `target` has or would get."""
    unfinished = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    with unfinished.open("x"):
        pass
    if target.exists():
        unfinished.chmod(target.stat().st_mode & 0o777)
    return unfinished


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
