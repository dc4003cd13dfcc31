"""Operating points of a sweep, a grid or a list, and the names of what can be swept."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.parameter_names import COMMAND, START, resolve
from jaxmuscle.parameters import Parameter, known_names, parameters
from jaxmuscle.simulation import Track
from jaxmuscle.sweeps.commands import Function
from jaxmuscle.sweeps.scenario import Bench


def checked_values(parameter: Parameter, name: str, values: object) -> np.ndarray:
    """`values` as an array with one entry a point along its first axis.

    Raises:
        InputError: another shape, not numbers, not finite, or outside the parameter's range.
    """
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name}: expected numbers in {parameter.unit or 'plain numbers'}: {error}"
        ) from error
    shape = parameter.shape
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape or not len(array):
        wanted = "n" + "".join(f", {size}" for size in shape)
        raise InputError(f"{name}: expected values of shape ({wanted}); got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: expected finite values; got {array[~np.isfinite(array)][0]}")
    if (parameter.positive and array.min() <= 0) or (parameter.nonnegative and array.min() < 0):
        least = "above zero" if parameter.positive else "zero or more"
        raise InputError(f"{name}: has to be {least}; got {array.min():g} {parameter.unit}".rstrip())
    return array


def swept(bench: Bench, name: str) -> Parameter:
    """What `name` stands for, with its path in the :class:`Bench`.

    Args:
        name: any of a parameter of the machine (:mod:`jaxmuscle.parameter_names`), ``command.…`` or
            ``start.…``.

    Raises:
        InputError: an unknown name; the message holds the nearest one.
    """
    known = dict(_known(bench))
    if name.startswith(COMMAND) and name not in known and not callable(bench.command):
        raise InputError(
            f"cannot sweep {name!r}: the command is a table, which has no parameters; "
            f"give a function of time, such as command=jm.commands.Sine()"
        )
    return resolve(known, name, "sweep")


def _known(bench: Bench) -> Iterator[tuple[str, Parameter]]:
    machine = bench.actuator
    for name, entry in known_names(machine).items():
        yield name, dataclasses.replace(entry, path=f"actuator.{entry.path}")
    if isinstance(bench.command, Track):
        return
    if isinstance(bench.command, eqx.Module):
        units = machine.units
        for name, entry in _of_command(bench.command):
            unit = re.sub(r"\{(\w+)\}", lambda found: units.get(found[1], found[0]), entry.unit)
            yield name, dataclasses.replace(entry, unit=unit)
    for name, value in bench.start.items():
        path, unit = START + name, machine.states[name].unit
        yield path, Parameter(path=path, value=value, unit=unit, meaning=f"{name} at the start")


def _of_command(command: eqx.Module) -> Iterator[tuple[str, Parameter]]:
    """The parameters of a command; numbers that a user's own module holds undeclared have no unit."""
    if isinstance(command, Function):
        for name, value in command.parameters.items():
            place = f"{COMMAND}parameters.{name}"
            yield COMMAND + name, Parameter(path=place, name=COMMAND + name, value=value)
        return
    for name, value in vars(command).items():
        if isinstance(value, float | int | np.ndarray | jax.Array):
            yield COMMAND + name, Parameter(path=COMMAND + name, value=value)
    for path, entry in parameters(command).items():
        yield COMMAND + path, dataclasses.replace(entry, path=COMMAND + path, name=COMMAND + path)


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
