"""Outputs of a sweep with dimensions and units: readings and reductions, coordinates, the dataset."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

import jaxmuscle
from jaxmuscle import actuators
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import parameters
from jaxmuscle.sweeps.job import FAILED, Variable
from jaxmuscle.sweeps.operating_points import Coordinates, Points
from jaxmuscle.sweeps.reductions import BY_NAME
from jaxmuscle.sweeps.scenario import Bench, Trajectory

TIME, MUSCLE = "time", "muscle"

Reductions = Sequence[str | Callable[..., Any]] | Mapping[str, Any] | None


@dataclasses.dataclass(frozen=True)
class Column:
    """A variable of the result: what is computed, its dimensions beyond the points, their lengths, unit.

    `absolute`: whether it is a pressure against vacuum.
    """

    variable: Variable
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    unit: str
    meaning: str
    absolute: bool = False


def whole(run: Trajectory, reading: jax.Array) -> jax.Array:
    """All samples."""
    return reading


def columns_of(bench: Bench, outputs: Sequence[str] | None, reductions: Reductions) -> tuple[Column, ...]:
    """The columns that a user asks for.

    Args:
        outputs: readings, all when `None`.
        reductions: names of the catalogue and functions of a :class:`Trajectory`; or a mapping from
            names to such functions, to (function, unit) or to names; whole trajectories when `None`.

    Raises:
        InputError: an unknown reading or reduction, nothing asked for, two columns of one name.
    """
    readings = _readings(bench, outputs)
    if reductions is None:
        return tuple(
            _column(bench, name, whole, name, "{reading}", "", (TIME,), point=True) for name in readings
        )
    if isinstance(reductions, str) or callable(reductions):
        reductions = [reductions]
    named = isinstance(reductions, Mapping)
    pairs = list(reductions.items()) if named else [(None, entry) for entry in reductions]
    found = [column for name, entry in pairs for column in _reduced(bench, readings, name, entry)]
    names = [column.variable.name for column in found]
    if not found or len({*names, FAILED}) <= len(names):
        raise InputError(f"reductions: expected at least one, each under a name of its own; got {names}")
    return tuple(found)


def _readings(bench: Bench, outputs: Sequence[str] | None) -> tuple[str, ...]:
    known = tuple(bench.actuator.outputs)
    wanted = known if outputs is None else (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in wanted:
        if name not in known:
            raise InputError(f"outputs: unknown reading {name!r}{nearest(name, known)}")
    if not wanted:
        raise InputError(f"outputs: expected some of {', '.join(known)}; got none")
    return wanted


def _reduced(bench: Bench, readings: Sequence[str], name: str | None, entry: Any) -> list[Column]:
    entry, unit = entry if isinstance(entry, tuple) else (entry, "")
    if callable(entry):
        own = name or getattr(entry, "__name__", "")
        if not own.isidentifier():
            raise InputError(f"reductions: give a function under a name, {{'name': …}}; got {entry!r}")
        return [_column(bench, own, entry, None, unit, own.replace("_", " "), ())]
    if entry not in BY_NAME:
        raise InputError(f"reductions: unknown {entry!r}{nearest(str(entry), BY_NAME)}")
    reduction = BY_NAME[entry]
    return [
        _column(
            bench, f"{r}_{name or entry}", reduction.function, r, reduction.unit,
            f"{r}: {reduction.meaning[0].lower()}{reduction.meaning[1:]}", (),
            reduction.point,
        )
        for r in readings
    ]  # fmt: skip


def _column(
    bench: Bench,
    name: str,
    function: Callable[..., Any],
    reading: str | None,
    unit: str,
    meaning: str,
    first: tuple[str, ...],
    point: bool = False,
) -> Column:
    variable = Variable(name, function, reading)
    try:
        shape = tuple(eqx.filter_eval_shape(variable, _example(bench)).shape)
    except (KeyError, TypeError, ValueError, jax.errors.JAXTypeError) as error:
        raise InputError(f"reductions: {name} cannot be computed from a run: {error}") from error
    if reading is None:
        dims = tuple(f"{name}.{axis}" for axis in range(len(shape)))
    else:
        dims = (*first, _numbering(bench, reading))[: len(shape)]
    given = bench.actuator.units.get("command", "")
    units = {"reading": _unit(bench, reading), "command": f"({given})" if " " in given else given}
    absolute = point and reading is not None and _declared(bench, reading).referenced
    return Column(variable, dims, shape, unit.format(**units), meaning or f"{name} over time", absolute)


def _numbering(bench: Bench, reading: str) -> str:
    """Dimension of the entries of a reading: the muscles, or its own where these are others."""
    machine = bench.actuator
    return MUSCLE if len(machine.outputs[reading]) == len(machine.commands) else f"{reading}.entry"


def _unit(bench: Bench, reading: str | None) -> str:
    return _declared(bench, reading).unit if reading else ""


def _declared(bench: Bench, reading: str) -> actuators.Column:
    """What the rig declares of the first column of a reading."""
    return bench.actuator.column(bench.actuator.outputs[reading][0])


def _example(bench: Bench) -> Trajectory:
    """A run of the shapes and types of this bench's, without numbers."""
    samples, machine = len(bench.times), bench.actuator

    def series(columns: int) -> Array:
        return jnp.zeros((samples, columns) if columns > 1 else samples)

    def run() -> Trajectory:
        readings = {name: series(len(columns)) for name, columns in machine.outputs.items()}
        number = None if getattr(bench.command, "frequency", None) is None else jnp.zeros(())
        return Trajectory(series(1), series(len(machine.commands)), readings, number)

    return jax.eval_shape(run)


Variables = dict[str, tuple[tuple[str, ...], tuple[int, ...], dict[str, str]]]
"""Variable → its dimensions, shape and attributes."""


def coordinates(bench: Bench, points: Points, columns: Sequence[Column]) -> Coordinates:
    """Coordinates of the result: those of the points, and the time where trajectories are kept."""
    found = points.coordinates()
    if any(TIME in column.dims for column in columns):
        found[TIME] = ((TIME,), np.asarray(bench.times), {"units": "s", "long_name": "time"})
    if any(MUSCLE in column.dims for column in columns):
        numbers = np.arange(1, len(bench.actuator.commands) + 1)
        found[MUSCLE] = ((MUSCLE,), numbers, {"long_name": "number of the muscle"})
    return found


def attributes(bench: Bench) -> dict[str, str]:
    """What the whole result says of itself."""
    values = {path: np.asarray(p.value).tolist() for path, p in parameters(bench.actuator).items()}
    return {
        "title": f"sweep of a {bench.actuator.rig} actuator; SI units, pressures absolute",
        "rig": bench.actuator.rig,
        "command": type(bench.command).__name__,
        "parameters": json.dumps(values),
        "source": f"jaxmuscle {jaxmuscle.__version__}",
    }


def variables(points: Points, columns: Sequence[Column]) -> Variables:
    """Variable → its dimensions, shape and attributes."""
    dims, shape = tuple(points.dims), points.shape
    found = {c.variable.name: ((*dims, *c.dims), (*shape, *c.shape), _said_of(c)) for c in columns}
    return {**found, FAILED: (dims, shape, {"long_name": "whether the run is not finite throughout"})}


def _said_of(column: Column) -> dict[str, str]:
    reference = {"reference": "absolute"} if column.absolute else {}
    return {"units": column.unit, "long_name": column.meaning, **reference}


def in_memory(
    bench: Bench, points: Points, columns: Sequence[Column], results: Mapping[str, np.ndarray]
) -> xr.Dataset:
    """The result as a dataset."""
    data = {
        name: (dims, results[name], attrs) for name, (dims, _, attrs) in variables(points, columns).items()
    }
    return xr.Dataset(data, coordinates(bench, points, columns), attributes(bench))
