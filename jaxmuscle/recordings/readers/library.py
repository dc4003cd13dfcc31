"""Libraries that read files, imported when a file asks for them."""

from __future__ import annotations

import importlib
import warnings
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
