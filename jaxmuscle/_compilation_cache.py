"""Folder in which JAX keeps compiled programs for later processes (its persistent compilation cache)."""

from __future__ import annotations

import contextlib
import os
import warnings
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from jaxmuscle.errors import InputError

MOST_BYTES = 256 * 2**20
"""Size to which the folder is cut when it is opened. A diagnosis adds some 2 MB."""
ENTRY = "-cache"
"""Ending of the files in which JAX keeps a program."""
TRACE = "-trace"
"""Ending of those in which the package keeps how one was traced (:mod:`jaxmuscle._traced_programs`)."""
SETTINGS = {
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
"""Keep every program: a diagnosis compiles some hundred small ones, which take seconds together."""
_before: dict[str, Any] = {}
"""What JAX was set to before :func:`switch_on`; empty while the cache is off or the user's own."""


def default_folder() -> Path:
    """The user's folder for what may be thrown away: ``~/.cache/jaxmuscle/programs`` on Linux."""
    return user_cache_path("jaxmuscle", appauthor=False) / "programs"


def in_use(jax: Any) -> Path | None:
    """The folder that JAX keeps programs in, whoever chose it; `None` if it keeps none."""
    folder = jax.config.jax_compilation_cache_dir
    return Path(folder) if folder and jax.config.jax_enable_compilation_cache else None


def own_folder(jax: Any) -> Path | None:
    """The folder, if it is the package that has JAX keep programs there; `None` also where the user has."""
    return in_use(jax) if _before else None


def switch_on(jax: Any, folder: Path | None = None) -> None:
    """Have JAX keep the programs that it compiles, and take those that it finds.

    JAX names a program by its operations, the versions of JAX and jaxlib, the options of XLA and name and
    features of the CPU: a folder that was carried to another machine is of no use there, and does no harm.
    A program that cannot be read (cut short, being written by another process) is compiled as if it were not
    there. jaxlib 0.10 with the options of :mod:`jaxmuscle._config` cannot keep programs whose
    intermediate results lie in several places; they are compiled each time.

    Where the user has chosen a folder for JAX, or has forbidden it to keep programs, all stays as it is.

    Args:
        folder: where; :func:`default_folder` when `None`, and nothing is kept if that cannot be written.

    Raises:
        InputError: `folder` cannot be written.
    """
    if not jax.config.jax_enable_compilation_cache or (in_use(jax) and not _before):
        return
    place = default_folder() if folder is None else folder.expanduser().absolute()
    refusal = _refusal(place)
    if refusal and folder is not None:
        raise InputError(
            f"expected a folder that can be written for compile_cache; {str(place)!r}: {refusal}"
        )
    if refusal or in_use(jax) == place:
        return
    _shorten(place)
    # JAX goes on without an entry that it cannot read or write, and warns of each.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    _set(jax, {"jax_compilation_cache_dir": str(place), **SETTINGS})


def switch_off(jax: Any) -> None:
    """Set JAX back to what it was before :func:`switch_on`; a folder that the user has chosen stays."""
    if _before:
        _set(jax, dict(_before))
        _before.clear()


def _set(jax: Any, settings: dict[str, Any]) -> None:
    from jax.experimental.compilation_cache.compilation_cache import reset_cache

    for name, value in settings.items():
        _before.setdefault(name, getattr(jax.config, name))
        jax.config.update(name, value)
    # JAX looks at the settings once, when it first compiles.
    reset_cache()


def _refusal(folder: Path) -> str | None:
    """Why the folder cannot be used; it is made if it is not there, for this user alone."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        return error.strerror or str(error)
    return None if os.access(folder, os.R_OK | os.W_OK | os.X_OK) else "no permission"


def _shorten(folder: Path, most: int = MOST_BYTES) -> None:
    """Remove the programs that were not used for longest, until the others take at most `most` bytes.

    JAX can do that itself, with the package filelock and a lock around every program that is read.
    """
    found = []
    for entry in (*folder.glob(f"*{ENTRY}"), *folder.glob(f"*{TRACE}")):
        with contextlib.suppress(OSError):  # another process may have removed it
            status = entry.stat()
            found.append((max(status.st_atime, status.st_mtime), status.st_size, entry))
    kept = 0
    for _, size, entry in sorted(found, key=lambda each: each[0], reverse=True):
        kept += size
        if kept > most:
            with contextlib.suppress(OSError):  # nor can Windows remove one that is being read
                entry.unlink()
