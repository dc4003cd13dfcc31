"""Options of XLA that jaxlib 0.10 needs for loops on a CPU, and how they are put into the environment."""

from __future__ import annotations

from collections.abc import MutableMapping
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

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
of a batch that fits into a core's cache. Beyond, kernels are vectors long enough, and compiled as `COMPACT`
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
COMPACT = {
    APART: -1,
    "xla_llvm_enable_alias_scope_metadata": False,
    "xla_llvm_enable_noalias_metadata": False,
}
"""Options of one compilation: as in :data:`CAREFUL`, for programs so large that compiling them with every
result apart takes much memory (2.4 instead of 1.7 GB in a diagnosis).
"""
Environment = MutableMapping[str, str]


def needed() -> bool:
    """Whether the installed jaxlib needs options; XLA ends the program at an option that it does not know."""
    return version("jaxlib").startswith(NEEDED_BY)


def compact() -> dict[str, Any] | None:
    """Options of a compilation that is to take little memory; `None` for a jaxlib that needs none."""
    return COMPACT if needed() else None


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
    # The level of XLA's own log stays where it is put; that of Python's goes back.
    jax.config.update("jax_logging_level", "ERROR")
    jax.config.update("jax_logging_level", level)
    # Processes begun by this one inherit the options, and are to be as quiet.
    environment[LOG] = "2"
    return True
