"""Libraries that read files: imported when a file asks for them, their errors as messages about the file."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jaxmuscle.errors import InputError


def library(module: str, package: str, path: Path) -> Any:
    """A module of a package that reads files such as `path`.

    Raises:
        InputError: the package is not installed; the message has the command that installs it.
    """
    try:
        with warnings.catch_warnings():
            # What its authors still have to change is no news to who reads a file.
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"{path}: reading such a file needs the package {package}, which cannot be imported ({error}); "
            f"install it, python -m pip install {package}, or the readers of all files, 'jaxmuscle[files]'"
        ) from error


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a file into an `InputError`.

    A library that meets bytes of another kind, or a file that was cut short, may raise anything.

    Args:
        path: begins the message.
        kind: what the file was taken for.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise InputError(f"{path}: cannot be read as {kind}: {reason}") from error
