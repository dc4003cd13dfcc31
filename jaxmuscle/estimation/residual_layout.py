"""Layout of the residual vector: link, window, sample and column of each residual, and its place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.estimation.windows import Problem

Values = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class ResidualLayout:
    """The order of the residuals of one recording in a vector: link by link as the rig declares its links,
    in each window by window, in each sample by sample, in each column by column.

    Attributes:
        columns: output of each link, in their order → its columns.
        rows: row of the recording that each sample of each window is; behind the end, the last row.
    """

    columns: Mapping[str, tuple[str, ...]]
    rows: Int[np.ndarray, "windows samples"]

    @classmethod
    def of(cls, actuator: AbstractActuator, problem: Problem) -> ResidualLayout:
        """That of a machine's residuals on a problem."""
        columns = {link.output: actuator.outputs[link.output] for link in actuator.links}
        return cls(columns, problem.sample_rows)

    def size(self, output: str) -> int:
        """Number of residuals of one output."""
        return self.rows.size * len(self.columns[output])

    def parts(self) -> dict[str, slice]:
        """Output → its place in the vector."""
        found, begin = {}, 0
        for output in self.columns:
            found[output] = slice(begin, begin + self.size(output))
            begin += self.size(output)
        return found

    def split(self, values: Float[np.ndarray, "... n"]) -> dict[str, Values]:
        """Output → its part of a vector as (…, windows, samples, columns); leading axes are kept."""
        values = np.asarray(values)
        shape = (*values.shape[:-1], *self.rows.shape)
        return {out: values[..., part].reshape(*shape, -1) for out, part in self.parts().items()}

    def join(self, parts: Mapping[str, ArrayLike]) -> Float[np.ndarray, " n"]:
        """The vector of what is given for each output, in any shape of that many numbers."""
        return np.concatenate([np.asarray(parts[output], dtype=float).ravel() for output in self.columns])

    def table(self, output: str, values: ArrayLike) -> Values:
        """What is given for one output, weights or predictions, as (windows, samples, columns)."""
        return np.asarray(values).reshape(*self.rows.shape, len(self.columns[output]))
