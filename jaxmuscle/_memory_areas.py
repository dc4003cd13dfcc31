"""Areas of memory of this process, of which every compiled program takes several and Linux allows 65,530.

One more, and LLVM ends the process ("Unable to allocate section memory"), however much memory is free: after
some forty diagnoses of different rigs and lengths in one process.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import jax

AREAS = Path("/proc/self/maps")
"""One in a line; only Linux has it, and only Linux counts."""
MOST = Path("/proc/sys/vm/max_map_count")
PART = 0.5
"""Part of the most that may be taken when a long computation begins: one diagnosis takes up to 5,000."""


def make_room_for_programs() -> bool:
    """Have JAX forget its compiled programs if they take so many areas that few are left; whether it did.

    Programs that are called again, the user's own too, are compiled again, or read where they are kept.
    """
    with contextlib.suppress(OSError):  # another system, or one that tells nobody
        if len(AREAS.read_bytes().splitlines()) > PART * int(MOST.read_text()):
            jax.clear_caches()
            return True
    return False
