"""Points divided over the cores of this machine."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

Arrays = tuple[NDArray[np.float64], ...]


@functools.cache
def cores() -> int:
    """Cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), thread_name_prefix="fit")


def divided(
    evaluate: Callable[[Float[NDArray, "some k"]], Arrays], points: Float[NDArray, "lanes k"]
) -> Arrays:
    """`evaluate` on parts of equal length side by side, joined; the last part is filled with its last point.

    XLA runs one program on one core; a second thread keeps the next one busy.
    """
    workers = min(cores(), len(points))
    if workers == 1:
        return evaluate(points)
    width = -(-len(points) // workers)
    filled = np.concatenate([points, np.repeat(points[-1:], workers * width - len(points), axis=0)])
    parts = list(_pool().map(evaluate, np.split(filled, workers)))
    return tuple(np.concatenate(each)[: len(points)] for each in zip(*parts, strict=True))
