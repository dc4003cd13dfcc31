"""Stores of a sweep: arrays in memory, or Zarr block by block, so that an interrupted sweep goes on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import xarray as xr

from jaxmuscle.errors import InputError
from jaxmuscle.files import new_folder, told_where
from jaxmuscle.sweeps.job import FAILED, Results
from jaxmuscle.sweeps.operating_points import Block


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


MARK = "jaxmuscle_sweep"
"""Attribute with the fingerprint of the sweep that a store holds."""
BLOCK = "jaxmuscle_block"
"""Attribute with the shape of a block."""
WRITTEN = "progress/written"
"""How often each block has been written; 0 means that it is still to be computed."""

Variables = Mapping[str, tuple[tuple[str, ...], tuple[int, ...], Mapping[str, str]]]


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise InputError("store: needs zarr; pip install 'jaxmuscle[distributed]'") from error
    return zarr


class Store:
    """The store of one sweep; holds only its place, so that it travels to workers.

    Every block is one chunk of each array, so that workers write side by side without locks. A block is
    marked when all of its arrays are written.
    """

    def __init__(self, place: Any) -> None:
        """`place`: path, URL or Zarr store, reachable by every worker."""
        self.place = str(Path(place).absolute()) if _is_path(place) else place

    def _group(self, mode: Any = "r+") -> Any:
        return _zarr().open_group(self.place, mode=mode)

    def block_shape(self, fingerprint: str) -> tuple[int, ...] | None:
        """Shape of the blocks of the sweep that is here; `None` when there is nothing yet.

        Raises:
            InputError: the place holds something else.
        """
        zarr = _zarr()
        if _is_path(self.place) and Path(self.place).exists() and not any(Path(self.place).iterdir()):
            return None
        try:
            held = dict(self._group("r").attrs)
        except (FileNotFoundError, zarr.errors.GroupNotFoundError):
            if _is_path(self.place) and Path(self.place).exists():
                raise self._taken("something that is no Zarr store") from None
            return None
        if held.get(MARK) != fingerprint:
            raise self._taken("another sweep" if MARK in held else "a Zarr store that holds no sweep")
        return tuple(held[BLOCK])

    def _taken(self, what: str) -> InputError:
        return InputError(f"store: {self.place} is {what}; choose another place, or delete it")

    def create(
        self,
        fingerprint: str,
        block: tuple[int, ...],
        count: int,
        variables: Variables,
        coordinates: xr.Dataset,
    ) -> None:
        """Lay out the arrays: a folder is there with all of them, or not at all.

        Raises:
            InputError: the system refuses to write them.
        """
        with new_folder(Path(self.place)) if _is_path(self.place) else nullcontext(self.place) as place:
            Store(place)._lay_out(fingerprint, block, count, variables, coordinates)

    def _lay_out(
        self,
        fingerprint: str,
        block: tuple[int, ...],
        count: int,
        variables: Variables,
        coordinates: xr.Dataset,
    ) -> None:
        """The mark comes last: without it a store is not taken up again."""
        coordinates.to_zarr(self.place, mode="w-", consolidated=False, zarr_format=3)
        group = self._group()
        for name, (dims, shape, attributes) in variables.items():
            logical = name == FAILED
            group.create_array(
                name,
                shape=shape,
                chunks=(*block, *shape[len(block) :]),
                dtype=bool if logical else np.float64,
                fill_value=False if logical else np.nan,
                dimension_names=dims,
                attributes=dict(attributes),
            )
        group.create_array(WRITTEN, shape=(count,), chunks=(1,), dtype=np.int64, fill_value=0)
        group.attrs.update({MARK: fingerprint, BLOCK: list(block)})

    def missing(self, blocks: int) -> list[int]:
        """Numbers of the blocks that have not been written yet."""
        return [int(number) for number in np.flatnonzero(self.times_written()[:blocks] == 0)]

    def times_written(self) -> np.ndarray:
        """How often each block has been written."""
        return np.asarray(self._group("r")[WRITTEN][:])

    def has(self, number: int) -> bool:
        """Whether a block has been written."""
        return bool(self._group("r")[WRITTEN][number])

    def write(self, number: int, block: Block, results: Results) -> None:
        """Write the arrays of a block, then mark it."""
        with told_where(self.place):
            group = self._group()
            for name, values in results.items():
                group[name][block] = values
            written = group[WRITTEN]
            written[number] = int(written[number]) + 1

    def open(self) -> xr.Dataset:
        """The result; its arrays are read when they are used."""
        found = xr.open_zarr(self.place, consolidated=False, chunks=None)
        return found.drop_attrs(deep=False).assign_attrs(
            {name: value for name, value in found.attrs.items() if name not in (MARK, BLOCK)}
        )


def _is_path(place: Any) -> bool:
    return isinstance(place, Path) or (isinstance(place, str) and "://" not in place)
