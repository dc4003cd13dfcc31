"""How a sweep is cut: batches that are computed side by side, blocks that are tasks and chunks of a store.

All batches have one size, so that a sweep is compiled once; the last batch of a block is filled up with
copies. A block is a box of the grid, so that it is exactly one chunk of every array in a store. The cut
depends on the sweep and on the memory limit only, never on how many cores or workers there are: the same
numbers to the last bit wherever it runs.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

from jaxmuscle.errors import InputError
from jaxmuscle.sweeps.points import Block

LARGEST_BATCH = {"cpu": 256, "gpu": 65536}
"""Points side by side. A run of a muscle takes a core 65 us among 64, 47 among 128, 37 among 256, 36 among
384, and from 512 on twice as long."""
LARGEST_BLOCK = {"cpu": 4096, "gpu": 4 * 65536}
"""Points of a task: about a second of work."""
FEWEST_BLOCKS = 32
"""Blocks that a sweep is cut into if it is large enough: for progress, and to share them out evenly."""
FEWEST_BATCHES = 4
LANES = 8
"""A batch is a multiple of this: no point is left for a loop over the remainder of a vector."""
BATCH_SHARE, BLOCK_SHARE = 0.25, 0.125
"""Parts of the memory limit that one batch at work and the results of one block may take."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """Points in a batch, shape of a block, and the memory that a block takes while it is computed [B]."""

    batch: int
    block: tuple[int, ...]
    working: int

    def blocks(self, shape: tuple[int, ...]) -> list[Block]:
        """All blocks of a grid, in C order."""
        starts = [range(0, n, b) for n, b in zip(shape, self.block, strict=True)]
        return [
            tuple(slice(a, min(a + b, n)) for a, b, n in zip(corner, self.block, shape, strict=True))
            for corner in itertools.product(*starts)
        ]


def cut(shape: tuple[int, ...], working: int, kept: int, memory: float, platform: str = "cpu") -> Cut:
    """How to cut a grid of points.

    Args:
        shape: length of each dimension.
        working: memory that a point takes while it is computed [B].
        kept: memory of its results [B].
        memory: limit [B].
        platform: kind of device.

    Raises:
        InputError: a single point takes more than the limit.
    """
    if working + kept > memory:
        raise InputError(
            f"memory: one point takes {_shown(working + kept)}, the limit is {_shown(memory)}; "
            f"raise memory=, take fewer samples with times="
        )
    kind = platform if platform in LARGEST_BATCH else "gpu"
    total = math.prod(shape)
    batch = min(LARGEST_BATCH[kind], _up(math.ceil(total / FEWEST_BATCHES), LANES))
    fits = int(BATCH_SHARE * memory // working)
    batch = batch if batch <= fits else max(1, fits // LANES * LANES or fits)
    largest = max(batch, min(LARGEST_BLOCK[kind], math.ceil(total / FEWEST_BLOCKS)))
    largest = max(1, min(_up(largest, batch), int(BLOCK_SHARE * memory // max(kept, 1))))
    block = _block(shape, largest, batch)
    return Cut(batch, block, batch * working + math.prod(block) * kept)


def _block(shape: tuple[int, ...], largest: int, batch: int) -> tuple[int, ...]:
    """The box of at most `largest` points that takes the fewest batches, the larger one of two equals.

    It spans the last dimensions, a part of one, and a single entry of those before it.
    """
    inner, axis = 1, len(shape)
    while axis and inner * shape[axis - 1] <= largest:
        axis -= 1
        inner *= shape[axis]
    if axis == 0:
        return shape
    most = largest // inner
    candidates = range(max(1, most // 2), most + 1)
    split = min(candidates, key=lambda size: (_batches(shape[axis - 1], size, inner, batch), -size))
    return (*[1] * (axis - 1), split, *shape[axis:])


def _batches(length: int, size: int, inner: int, batch: int) -> int:
    """Batches along one dimension that is cut into parts of `size`."""
    whole, rest = divmod(length, size)
    return whole * math.ceil(size * inner / batch) + math.ceil(rest * inner / batch)


def _up(number: int, step: int) -> int:
    return math.ceil(number / step) * step


def _shown(size: float) -> str:
    return f"{size / 2**20:.3g} MiB"
