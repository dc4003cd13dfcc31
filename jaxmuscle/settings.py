"""Settings of JAX and XLA that the package needs; JAX reads some of them only as it starts."""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping

EXTRA = "--xla_backend_extra_options="
LOOPS = f"{EXTRA}xla_cpu_small_while_loop_byte_threshold={10**7}"
"""On a CPU, XLA compiles a loop that touches less than this many bytes into one function (without it 1 kB).

Any larger loop it runs kernel by kernel, at some 70 ns each: for one run of a muscle three times the time of
the arithmetic, for its Jacobian seven times, for its gradient in reverse mode twenty-five times.
"""


def prepare(environment: MutableMapping[str, str] = os.environ) -> None:
    """Double precision, and loops compiled as a whole.

    Single precision hides gradients that are not numbers and multiplies the steps of a fit. The setting for
    loops has no effect in a process whose JAX has already computed something, and gives way to the user's
    own extra options.
    """
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:
        environment["JAX_ENABLE_X64"] = "1"
    flags = environment.get("XLA_FLAGS", "")
    if EXTRA not in flags:
        environment["XLA_FLAGS"] = f"{flags} {LOOPS}".strip()
