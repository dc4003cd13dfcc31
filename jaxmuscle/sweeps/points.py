"""The operating points of a sweep: a grid, or a list of points."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Parameter
from jaxmuscle.sweeps.bench import Bench
from jaxmuscle.sweeps.names import checked_values, swept

POINT = "point"
"""Dimension of a list of points."""

Block = tuple[slice, ...]
"""A part of the points: one slice a dimension."""
Coordinates = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]


@dataclasses.dataclass(frozen=True, eq=False)
class Points:
    """Operating points on named dimensions.

    Attributes:
        dims: name → length of each dimension; points are counted in C order.
        leaves: name of what is swept → what it stands for.
        values: name → its values along its dimension.
        along: name → the position of its dimension in `dims`.
    """

    dims: dict[str, int]
    leaves: dict[str, Parameter]
    values: dict[str, np.ndarray]
    along: dict[str, int]

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each dimension."""
        return tuple(self.dims.values())

    def __len__(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape, dtype=np.int64))

    def inside(self, block: Block) -> dict[str, np.ndarray]:
        """Path of a leaf → its values at the points of a block, flat in C order."""
        index = np.meshgrid(
            *(np.arange(n)[part] for n, part in zip(self.shape, block, strict=True)), indexing="ij"
        )
        return {
            leaf.path: self.values[name][index[self.along[name]].ravel()]
            for name, leaf in self.leaves.items()
        }

    def coordinates(self) -> Coordinates:
        """Coordinate → its dimensions, values and attributes, as xarray takes them."""
        found: Coordinates = {}
        for name, leaf in self.leaves.items():
            dim = tuple(self.dims)[self.along[name]]
            attributes = {"units": leaf.unit, "long_name": leaf.meaning or name}
            key = f"{name}.values" if leaf.shape and dim == name else name
            entries = tuple(f"{name}.{axis}" for axis in range(len(leaf.shape)))
            found[key] = ((dim, *entries), self.values[name], attributes)
        return found


def points_of(bench: Bench, over: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Points:
    """The grid of a mapping name → values, or the list of points of a sequence of mappings name → value.

    Raises:
        InputError: nothing to sweep, an unknown name, two names of one leaf, values that do not fit.
    """
    if isinstance(over, Mapping):
        given = dict(over)
    elif (
        isinstance(over, Sequence) and not isinstance(over, str) and all(isinstance(p, Mapping) for p in over)
    ):
        given = _side_by_side(over)
    else:
        raise InputError(
            "over: expected a mapping from names to values (a grid), "
            f"or a list of mappings from names to a value (points); got {type(over).__name__}"
        )
    if not given:
        raise InputError("over: nothing to sweep; expected at least one name with its values")
    leaves = {name: swept(bench, name) for name in given}
    _check_once(leaves)
    values = {name: checked_values(leaves[name], name, given[name]) for name in given}
    if isinstance(over, Mapping):
        lengths = {name: len(array) for name, array in values.items()}
        return Points(lengths, leaves, values, {name: i for i, name in enumerate(values)})
    return Points({POINT: len(over)}, leaves, values, dict.fromkeys(values, 0))


def _side_by_side(points: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    if not points:
        return {}
    names = list(points[0])
    for number, point in enumerate(points):
        if set(point) != set(names):
            odd = ", ".join(sorted(set(point) ^ set(names)))
            raise InputError(f"over: expected the same names in every point; point {number} differs in {odd}")
    return {name: [point[name] for point in points] for name in names}


def _check_once(leaves: Mapping[str, Parameter]) -> None:
    seen: dict[str, str] = {}
    for name, leaf in leaves.items():
        if leaf.path in seen:
            raise InputError(
                f"over: {seen[leaf.path]!r} and {name!r} are the same parameter; remove one of them"
            )
        seen[leaf.path] = name
