"""Columns of a run by name, also what no sensor shows; their units, and pressures as parts of the highest."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.variables import Column, StateVariable
from jaxmuscle.recordings import Recording
from jaxmuscle.simulation.simulate import Simulation

Columns = Mapping[str, NDArray[np.float64]]


def columns_of(
    run: Recording | Simulation, actuator: AbstractActuator
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Clock and columns; gaps are bridged by straight lines."""
    if isinstance(run, Recording):
        clock, found = run.time, run.columns
    else:
        table = run.to_frame()
        clock = table.index.to_numpy(dtype=float)
        found = {str(name): table[name].to_numpy(dtype=float) for name in table}
        if run.command is not None:
            found |= _numbered(actuator.commands, run.command)
        for name, values in (run.states or {}).items():
            if name in actuator.states:
                kept = _numbered(_state_columns(actuator, name, np.size(values[0])), values)
                found |= {column: kept[column] for column in kept if column not in found}
    return clock, {
        name: _bridged(clock, values) for name, values in found.items() if np.isfinite(values).any()
    }


def _numbered(names: Sequence[str], values: ArrayLike) -> dict[str, NDArray[np.float64]]:
    """Columns of an array with an axis of samples in front."""
    table = np.asarray(values, dtype=float)
    return dict(zip(names, table.reshape(len(table), -1).T, strict=False))


def _state_columns(actuator: AbstractActuator, name: str, count: int) -> tuple[str, ...]:
    """Names of a state's entries: its columns, or its own name, numbered from 1 where there are several."""
    measured = actuator.measured.get(name, ())
    if len(measured) == count:
        return tuple(measured)
    return (name,) if count == 1 else tuple(f"{name}_{i + 1}" for i in range(count))


def where_to_find(missing: Sequence[str], actuator: AbstractActuator) -> str:
    """What to do about columns that a run does not have."""
    if actuator.imposed:
        return "What a bench imposes is in the recording: animate(recording, actuator)"
    hidden = actuator.states.keys() - actuator.measured.keys()
    if any(_base(name) in hidden for name in missing):
        return (
            "A simulation that keeps its states has what no sensor shows: "
            "animate(simulate(actuator, …, states=True), actuator)"
        )
    return "Is it a run of this machine?"


def _base(name: str) -> str:
    """A name without the number of an entry."""
    return re.sub(r"_\d+$", "", name)


def _bridged(clock: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.isfinite(values)
    return values if known.all() else np.interp(clock, clock[known], values[known])


def unit_of(actuator: AbstractActuator, name: str) -> str:
    """SI unit of a column or of an entry of a state."""
    declared = _declared(actuator, name)
    return declared.unit if declared else ""


def is_pressure(actuator: AbstractActuator, name: str) -> bool:
    """Whether a column or an entry of a state is an absolute pressure, measured or commanded."""
    declared = _declared(actuator, name)
    return declared is not None and declared.unit == "Pa" and not declared.difference


def _declared(actuator: AbstractActuator, name: str) -> Column | StateVariable | None:
    """What a rig declares of a column, or of a state or the state of an entry."""
    return actuator.columns.get(name) or actuator.states.get(name) or actuator.states.get(_base(name))


def pressure_levels(
    actuator: AbstractActuator, columns: Columns, now: Mapping[str, float]
) -> dict[str, float]:
    """Pressures, and commands of pressures, as parts of the highest gauge pressure of the run."""
    ambient = float(getattr(actuator, "ambient_pressure", 0.0))
    names = [name for name in now if is_pressure(actuator, name)]
    pressures = [columns[name].max() for name in names if name in columns and name not in actuator.commands]
    highest = float(max(pressures, default=ambient)) - ambient
    return {name: (now[name] - ambient) / highest if highest > 0 else 0.0 for name in names}
