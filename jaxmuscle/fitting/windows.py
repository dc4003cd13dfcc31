"""Which stretches of a recording are predicted in one go."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int

from jaxmuscle.actuators.base import AbstractActuator

LONGEST_BATCH = 64
"""Windows into which a machine whose inputs are all imposed is cut: no error, only faster."""


@dataclasses.dataclass(frozen=True)
class Windows:
    """Windows of equal length; the last one of a stretch may be cut short by its mask.

    Attributes:
        rows: first row of each window.
        samples: their length.
        mask: whether a sample of a window belongs to its stretch.
        held_out: whether a window lies in a stretch that no fit and no selection may see.
    """

    rows: Int[np.ndarray, " windows"]
    samples: int
    mask: Bool[np.ndarray, "windows samples"]
    held_out: Bool[np.ndarray, " windows"]

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.rows)

    def sample_rows(self, total: int) -> Int[np.ndarray, "windows samples"]:
        """Row that each sample of each window is, of a recording of `total` rows."""
        return sample_rows(self.rows, self.samples, total)

    def ignoring(self, rows: Bool[np.ndarray, " all"]) -> Windows:
        """The same windows without the given rows of the recording."""
        return dataclasses.replace(self, mask=self.mask & ~np.asarray(rows)[self.sample_rows(len(rows))])


def sample_rows(
    first: Int[np.ndarray, " windows"], samples: int, total: int
) -> Int[np.ndarray, "windows samples"]:
    """Row of a recording of `total` rows that each sample of windows is; behind the end, the last row."""
    return np.minimum(first[:, None] + np.arange(samples), total - 1)


def cut(
    actuator: AbstractActuator, stretches: Sequence[tuple[int, int, bool]], step: float, horizon: float | None
) -> Windows:
    """Cut stretches (first row, end, held out) into windows of `horizon` seconds.

    Without a horizon each stretch is one window, unless the bench imposes every state of the rig: then
    nothing is started anew at a window's edge and the length is free.
    """
    longest = max(stop - start for start, stop, _ in stretches)
    if set(actuator.imposed) >= {*actuator.measured, *actuator.derivatives}:
        total = sum(stop - start for start, stop, _ in stretches)
        samples = min(longest, max(50, -(-total // LONGEST_BATCH)))
    elif horizon is None:
        samples = longest
    else:
        samples = min(longest, max(2, round(horizon / step)))
    rows, masks, held = [], [], []
    for start, stop, out in stretches:
        for row in range(start, stop, samples):
            rows.append(row)
            masks.append(np.arange(samples) < stop - row)
            held.append(out)
    return Windows(np.array(rows), samples, np.array(masks), np.array(held))
