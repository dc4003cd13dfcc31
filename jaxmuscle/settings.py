"""Settings of JAX and XLA that the package needs; JAX reads some of them only as it starts."""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping
from importlib.metadata import version

TESTED = ("0.10.",)
"""Releases of jaxlib that take the options below: XLA ends the program at one that it does not know."""
SMALL = "xla_cpu_small_while_loop_byte_threshold"
LOOPS = {
    "--xla_backend_extra_options": f"{SMALL}=30000",
    "--xla_llvm_enable_alias_scope_metadata": "false",
    "--xla_llvm_enable_noalias_metadata": "false",
}
"""On a CPU, XLA compiles a loop that touches less than this many bytes into one function (else 1 kB).

Any larger loop it runs kernel by kernel, which is most of the time of a single run, of its Jacobian and of
its gradient. Batches of many runs are larger and stay kernels, whose loops are vectors: for them that is
faster. The two other options keep LLVM from reordering on the ground that XLA's buffers never overlap: with
that, derivatives of the elbow came out wrong in a loop compiled as a whole (jaxlib 0.10.2; its test with
finite differences shows it), and a Jacobian that takes twice as long is the smaller loss.
"""


def prepare(environment: MutableMapping[str, str] = os.environ) -> None:
    """Double precision, and small loops compiled as a whole.

    Single precision hides gradients that are not numbers and multiplies the steps of a fit. The options for
    loops are left alone if the user gives one of them, and come too late, without harm, in a process whose
    JAX has already computed something.
    """
    if "jax" in sys.modules:
        sys.modules["jax"].config.update("jax_enable_x64", True)
    else:
        environment["JAX_ENABLE_X64"] = "1"
    flags = environment.get("XLA_FLAGS", "")
    if version("jaxlib").startswith(TESTED) and not any(option in flags for option in LOOPS):
        environment["XLA_FLAGS"] = " ".join([flags, *(f"{k}={v}" for k, v in LOOPS.items())]).strip()
