"""What importing the package sets in JAX and XLA; `configure` says it and switches it."""

from __future__ import annotations

import dataclasses
import os
import sys
import warnings
from collections.abc import Mapping
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxmuscle import compile_cache as programs
from jaxmuscle.errors import InputError
from jaxmuscle.xla_options import Environment, add_options, needed, present, remove_options

TESTED = ("0.10.", "0.12.")
"""Releases of jaxlib that the tests have passed on."""
X64 = "JAX_ENABLE_X64"


@dataclasses.dataclass(frozen=True)
class Configuration:
    """What is set in JAX and XLA in this process.

    Attributes:
        x64: whether JAX computes in double precision.
        xla_options: options of this package in ``XLA_FLAGS``; none but for jaxlib 0.10.
        jaxlib: the installed release.
        tested: whether the package was tested with that release.
        compile_cache: folder in which JAX keeps compiled programs, this package's or the user's own.
    """

    x64: bool
    xla_options: tuple[str, ...]
    jaxlib: str
    tested: bool
    compile_cache: Path | None = None


def configure(
    *,
    x64: bool | None = None,
    xla_options: bool | None = None,
    compile_cache: bool | str | Path | None = None,
) -> Configuration:
    """Say what importing the package set in JAX and XLA, and switch it.

    ``import jaxmuscle`` switches JAX to double precision, for all JAX code of the process: arrays of other
    code become float64 too and take twice the memory. A single precision of 1e-7 hides gradients that are not
    numbers and lets the small steps of a fit drown. With jaxlib 0.10, and with that alone, it also writes
    options for loops on a CPU into ``XLA_FLAGS`` (:mod:`jaxmuscle.xla_options`), which processes begun by
    this one inherit. Who sets ``JAX_ENABLE_X64`` or one of the options before the import keeps what he set.

    Compiled programs are kept for the next process if that is asked for. The command line program does, which
    saves 40 to 50 % of the processor time of a second diagnosis. An import does not, because JAX would keep
    the programs of all code of the process, and write files. Who has set ``JAX_COMPILATION_CACHE_DIR``, or
    ``JAX_ENABLE_COMPILATION_CACHE=false``, keeps what he set.

    Args:
        x64: switch double precision on or off. Without it simulations are single, and fits and diagnoses
            refuse to begin. Arrays that exist already keep their precision.
        xla_options: add the options or take them out again; before JAX has computed anything.
        compile_cache: have JAX keep compiled programs in the user's cache folder (``~/.cache/jaxmuscle`` on
            Linux) or in a folder of your own, or end that. Nobody else may write there: programs are run as
            they are found.

    Raises:
        InputError: the options are to change, but JAX has already computed something; the folder that was
            given for programs cannot be written.
    """
    import jax

    if x64 is not None:
        jax.config.update("jax_enable_x64", x64)
    if xla_options is not None:
        _switch_options(xla_options, jax)
    if compile_cache is False:
        programs.switch_off(jax)
    elif compile_cache is not None:
        programs.switch_on(jax, None if compile_cache is True else Path(compile_cache))
    release = version("jaxlib")
    return Configuration(
        bool(jax.config.read("jax_enable_x64")),
        present(os.environ),
        release,
        release.startswith(TESTED),
        programs.in_use(jax),
    )


def prepare(environment: Environment = os.environ, modules: Mapping[str, Any] = sys.modules) -> None:
    """Switch double precision on, add options for jaxlib 0.10, warn of a release that is not tested.

    Done when the package is imported. JAX is not imported for that, so that the command line answers at
    once: if it is not there yet, precision is switched as soon as it comes (:class:`_PrecisionFinder`). No
    environment variable is written for it, which other programs would inherit.
    """
    jax = modules.get("jax")
    if X64 not in environment:
        if jax is not None:
            jax.config.update("jax_enable_x64", True)
        elif not any(isinstance(finder, _PrecisionFinder) for finder in sys.meta_path):
            sys.meta_path.insert(0, _PrecisionFinder())
    if needed():
        add_options(environment, jax)
    release = version("jaxlib")
    if not release.startswith(TESTED):
        known = " and ".join(f"{tested}x" for tested in TESTED)
        warnings.warn(
            f"jaxmuscle was tested with jaxlib {known}; {release} is installed. Its tests tell whether that "
            f"works as well: python -m pytest, in a checkout of jaxmuscle",
            stacklevel=2,
        )


def require_double_precision(what: str) -> None:
    """Raise `InputError` where JAX computes in single precision; `what` cannot be done then."""
    import jax

    if not jax.config.read("jax_enable_x64"):
        raise InputError(
            f"{what} needs double precision, and JAX is set to single precision in this process. "
            f"Call jaxmuscle.configure(x64=True) before, or do not set {X64}"
        )


class _PrecisionFinder:
    """Finds JAX where everybody finds it, once, and switches double precision on when it has been loaded."""

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Answer for the module `jax` alone."""
        if name != "jax":
            return None
        sys.meta_path.remove(self)  # pyright: ignore[reportArgumentType]
        spec = find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        load = spec.loader.exec_module

        def load_and_switch(module: ModuleType) -> None:
            load(module)
            module.config.update("jax_enable_x64", True)

        spec.loader.exec_module = load_and_switch  # pyright: ignore[reportAttributeAccessIssue]
        return spec


def _switch_options(wanted: bool, jax: Any) -> None:
    if wanted == bool(present(os.environ)) or (wanted and not needed()):
        return
    from jax._src.xla_bridge import backends_are_initialized

    if backends_are_initialized():
        raise InputError(
            "expected configure(xla_options=…) before JAX computes anything in this process; it has already. "
            "Call it right after import jaxmuscle"
        )
    if wanted:
        add_options(os.environ, jax)
    else:
        remove_options(os.environ)
