"""Where the blocks of a sweep go: arrays in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np

from jaxmuscle.sweeps.job import Results
from jaxmuscle.sweeps.points import Block


class Sink(Protocol):
    """Takes the results of blocks, in any order and from several threads at once."""

    def missing(self, blocks: int) -> list[int]:
        """Numbers of the blocks that have not been written yet."""
        ...

    def write(self, number: int, block: Block, results: Results) -> None:
        """Take the results of a block."""
        ...


class Memory:
    """Arrays in memory: variable → array over all points."""

    def __init__(self, shapes: Mapping[str, tuple[int, ...]], logical: Iterable[str] = ()) -> None:
        """Arrays of the given shapes, of truth values for those named in `logical`."""
        logical = set(logical)
        self.arrays: Results = {
            name: np.empty(shape, bool if name in logical else float) for name, shape in shapes.items()
        }

    def missing(self, blocks: int) -> list[int]:
        """All blocks."""
        return list(range(blocks))

    def write(self, number: int, block: Block, results: Results) -> None:
        """Copy the results of a block to their place."""
        for name, values in results.items():
            self.arrays[name][block] = values
