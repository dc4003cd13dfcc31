"""Settings of JAX and XLA that the package needs; JAX reads some of them only as it starts."""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping

EXTRA = "--xla_backend_extra_options="
LOOPS = (
    f"{EXTRA}xla_cpu_small_while_loop_byte_threshold=30000",
    "--xla_llvm_enable_alias_scope_metadata=false",
    "--xla_llvm_enable_noalias_metadata=false",
)
"""On a CPU, XLA compiles a loop that touches less than this many bytes into one function (else 1 kB).

Any larger loop it runs kernel by kernel, at some 70 ns each: most of the time of a single run, of its
Jacobian and of its gradient. Batches of many runs are larger and stay kernels, whose loops are vectors: for
them that is faster. The two other settings keep LLVM from reordering on the ground that XLA's buffers never
overlap: with that, derivatives of the elbow came out wrong in a loop compiled as a whole (jaxlib 0.10.2),
and a Jacobian that takes twice as long is the smaller loss.
"""


def prepare(environment: MutableMapping[str, str] = os.environ) -> None:
    """Double precision, and small loops compiled as a whole.

    Single precision hides gradients that are not numbers and multiplies the steps of a fit. The settings for
    loops have no effect in a process whose JAX has already computed something, and give way to the user's
    own extra options.
    """
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:
        environment["JAX_ENABLE_X64"] = "1"
    flags = environment.get("XLA_FLAGS", "")
    if EXTRA not in flags:
        environment["XLA_FLAGS"] = " ".join([flags, *LOOPS]).strip()
