"""Settings of JAX and XLA: double precision, compiler options, the cores that this process may use.

`prepare` makes them when the package is imported; `configure` tells and switches them.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import sys
import warnings
from collections.abc import Mapping, MutableMapping
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxmuscle import _compilation_cache as programs
from jaxmuscle.errors import InputError


@functools.cache
def cores() -> int:
    """How many: those that it is confined to, where the system tells, else all of the machine."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


NEEDED_BY = ("0.10.",)
"""Releases of jaxlib that need the options below.

jaxlib 0.12 without any is as fast as 0.10 with them, and takes less memory.
Measured on two cores with 0.10.2 with them, 0.10.2 without, 0.12.0.1 without, 0.12.0.1 with them: one run of
`benchmarks/peers_ours.py` 0.78, 2.67, 0.74, 0.74 ms; its Jacobian 3.4, 22.4, 3.2, 3.2 ms; its gradient 4.4,
21.4, 4.5, 4.5 ms. First fits of four rigs, with the first, third and fourth: 53, 35, 46 s and 2.7, 1.1,
2.2 GB, to the same values.
"""
SMALL = "xla_cpu_small_while_loop_byte_threshold"
APART = "xla_multiheap_size_constraint_per_heap"
LOG = "TF_CPP_MIN_LOG_LEVEL"
QUIET = ("2", "3")
"""Its values without warnings; with anything that is not a number XLA tells all."""
QUIET_LEVELS = ("ERROR", "CRITICAL", "FATAL")
"""Levels of JAX's log, which moves XLA's with it, without warnings."""
WHOLE = {"--xla_backend_extra_options": f"{SMALL}=400000", f"--{APART}": "0"}
r"""On a CPU, XLA compiles a loop whose step touches less than this many bytes into one function (else 1 kB).

Any larger loop it runs kernel by kernel, which is most of the time of a single run, of its derivatives, and
of a batch that fits into a core's cache. Beyond, kernels are vectors long enough, and compiled as `CAREFUL`
a whole loop would be slower than they are.

XLA tells LLVM which of its buffers never overlap. In functions as large as these LLVM (23.0git, in jaxlib
0.10.2) draws too much from that: of two buffers that lie in the same place, one after the other, it reorders
the accesses, and derivatives of the elbow came out wrong. The same function translated by LLVM 22 is right.
The second option gives every intermediate result a place of its own (a heap of at most 0 bytes holds one),
so that whatever is told of two buffers is true. It costs memory: all intermediate results count, not only
those that are alive together. XLA warns of every one of them, which :func:`add_options` turns off.
"""
CAREFUL = {
    "--xla_backend_extra_options": f"{SMALL}=30000",
    "--xla_llvm_enable_alias_scope_metadata": "false",
    "--xla_llvm_enable_noalias_metadata": "false",
}
"""Instead of :data:`WHOLE` where its price is not known (an accelerator's memory) or its warnings are wanted.

Buffers share places, and LLVM is told nothing about them: a Jacobian takes twice as long.
"""
Environment = MutableMapping[str, str]


def needed() -> bool:
    """Whether the installed jaxlib needs options; XLA ends the program at an option that it does not know."""
    return version("jaxlib").startswith(NEEDED_BY)


def add_options(environment: Environment, jax: Any) -> None:
    """Write the options into ``XLA_FLAGS``, unless the user gives one of them; and turn XLA's warnings off.

    Too late, without harm, in a process whose JAX has already computed something.

    Args:
        jax: the module if it has been imported, else `None`.
    """
    flags = environment.get("XLA_FLAGS", "")
    if any(option in flags for option in {**WHOLE, **CAREFUL}):
        return
    options = WHOLE if not _accelerated() and _silenced(environment, jax) else CAREFUL
    environment["XLA_FLAGS"] = " ".join([flags, *written(options)]).strip()


def present(environment: Environment) -> tuple[str, ...]:
    """Those of the package's options that the environment holds."""
    ours = {*written(WHOLE), *written(CAREFUL)}
    return tuple(flag for flag in environment.get("XLA_FLAGS", "").split() if flag in ours)


def remove_options(environment: Environment) -> None:
    """Take the package's options out of ``XLA_FLAGS``; what the user put there stays."""
    ours, flags = present(environment), environment.get("XLA_FLAGS", "").split()
    rest = [flag for flag in flags if flag not in ours]
    if rest:
        environment["XLA_FLAGS"] = " ".join(rest)
    elif ours:
        del environment["XLA_FLAGS"]


def written(options: dict[str, str]) -> list[str]:
    """Options as ``XLA_FLAGS`` has them."""
    return [f"{name}={value}" for name, value in options.items()]


def _accelerated() -> bool:
    """Whether JAX could compute on something else than this CPU: its plugins lie in one namespace."""
    return find_spec("jax_plugins") is not None


def _silenced(environment: Environment, jax: Any) -> bool:
    """Turn XLA's warnings off, errors stay on; whether they are off now: not where the user wants them."""
    level = environment.get("JAX_LOGGING_LEVEL") if jax is None else jax.config.jax_logging_level
    if level not in (None, "", "NOTSET"):
        return level in QUIET_LEVELS
    if jax is None:
        return environment.setdefault(LOG, "2") in QUIET
    # JAX itself sets 1 when it is imported, too early for the variable to have an effect now.
    given = environment.get(LOG, "1")
    if given != "1":
        return given in QUIET
    _set_log_of_xla(jax, "ERROR")
    # Processes begun by this one inherit the options, and are to be as quiet.
    environment[LOG] = "2"
    return True


def _silence_errors(environment: Environment, jax: Any) -> None:
    """Turn XLA's log of errors off, too, where that of warnings is: what fails is raised anyway.

    For every kept program that jaxlib 0.10 reads it logs two errors of 2 kB: that this machine lacks features
    which are preferences of its compiler ("+prefer-no-gather", github.com/openxla/xla/issues/44565).
    """
    if environment.get(LOG) in QUIET:
        _set_log_of_xla(jax, "CRITICAL")


def _set_log_of_xla(jax: Any, least: str) -> None:
    """Have XLA log what is at least as grave; Python's log stays as it is, and what a user has set."""
    level = jax.config.jax_logging_level
    jax.config.update("jax_logging_level", least)
    jax.config.update("jax_logging_level", level)


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
    options for loops on a CPU into ``XLA_FLAGS`` (:mod:`jaxmuscle._config`), which processes begun by
    this one inherit. Who sets ``JAX_ENABLE_X64`` or one of the options before the import keeps what he set.

    Compiled programs, and how they were traced, are kept for the next process if that is asked for. The
    command line program does: a second diagnosis takes half the time. An import does not, because JAX would
    keep the programs of all code of the process, and write files. Who has set ``JAX_COMPILATION_CACHE_DIR``,
    or ``JAX_ENABLE_COMPILATION_CACHE=false``, keeps what he set.

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
        if needed() and programs.own_folder(jax):
            _silence_errors(os.environ, jax)
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
