"""The result of a sweep as a dataset: coordinates, variables and what it says of itself."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

import jaxmuscle
from jaxmuscle.parameters import parameters
from jaxmuscle.sweeps.bench import Bench
from jaxmuscle.sweeps.columns import MUSCLE, TIME, Column
from jaxmuscle.sweeps.job import FAILED
from jaxmuscle.sweeps.points import Coordinates, Points

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
