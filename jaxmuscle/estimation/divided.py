"""Points evaluated a few at a time, on all cores of this machine."""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.cores import cores

Arrays = tuple[NDArray[np.float64], ...]


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), thread_name_prefix="fit")


def divided(
    evaluate: Callable[[Float[np.ndarray, "width k"]], Arrays],
    points: Float[np.ndarray, "lanes k"],
    width: int,
) -> Arrays:
    """`evaluate` on so many points at a time, on all cores, joined.

    The last part is filled with its last point: all are of one shape, for which a function is compiled once
    however many points there are. XLA runs one program on one core; other threads keep the next ones busy.
    """
    parts = -(-len(points) // width)
    filled = np.concatenate([points, np.repeat(points[-1:], parts * width - len(points), axis=0)])
    pieces = np.split(filled, parts)
    found = [evaluate(pieces[0])] if parts == 1 else list(_pool().map(evaluate, pieces))
    return tuple(np.concatenate(each)[: len(points)] for each in zip(*found, strict=True))
