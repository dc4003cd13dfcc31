"""Cores that this process may use."""

from __future__ import annotations

import functools
import os


@functools.cache
def cores() -> int:
    """How many: those that it is confined to, where the system tells, else all of the machine."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1
