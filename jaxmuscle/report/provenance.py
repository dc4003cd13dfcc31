"""With what a result was made."""

from __future__ import annotations

import platform
from importlib.metadata import version

import jaxmuscle

PACKAGES = ("jax", "diffrax", "optimistix")


def versions() -> dict[str, str]:
    """Versions of everything that can change a result."""
    packages = {package: version(package) for package in PACKAGES}
    return {"jaxmuscle": jaxmuscle.__version__, **packages, "python": platform.python_version()}
