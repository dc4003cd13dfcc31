"""Parameters that can be fitted, by name: quantities of a card, dotted paths, sensor offsets, initial states
(``start.STATE``).
"""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.parameter_names import OFFSET, START
from jaxmuscle.parameters import Parameter, entries_of, known_names
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.simulation import Track, start_at_rest
from jaxmuscle.simulation.sensor_errors import true_track


def fittable(actuator: AbstractActuator, ranges: Mapping[str, float]) -> dict[str, Parameter]:
    """The parameters of a machine and the offsets of its sensors by name; the value of an offset is 0.

    Args:
        ranges: measured column → range of its samples (SI); the natural size of its offset is 1 % of it.
    """
    found = known_names(actuator)
    for column in measured_columns(actuator):
        found[OFFSET + column] = Parameter(
            path=OFFSET + column,
            value=0.0,
            unit=actuator.column(column).unit,
            meaning=f"what the sensor of {column} shows too much",
            typical=0.01 * ranges.get(column, 0.0) or None,
        )
    return found


def range_of(readings: NDArray[np.float64]) -> float:
    """Of the readings that are numbers; zero without any."""
    known = readings[np.isfinite(readings)]
    return float(np.ptp(known)) if known.size else 0.0


def start_places(actuator: AbstractActuator, recording: Recording) -> dict[str, Parameter]:
    """Every state at the first sample of a recording that a fit can move, by its name and by its entries.

    A measured state and its rate, unless the bench imposes them; a hidden state of the machine; the state of
    an effect that is one array of numbers (of creep, of play operators), by the effect's name. Values are the
    first readings (as they are, not smoothed as a state is that is not fitted), zero for a rate, or those at
    rest under them.
    """
    found: dict[str, Parameter] = {}
    for name, value in _resting(actuator, recording).items():
        values = np.asarray(value)
        unit, path = _unit(actuator, name), START + name
        begin = "zero" if name in actuator.derivatives else "rest"
        begin = "its first reading" if name in actuator.measured else begin
        meaning = f"{name} at the first sample of the recording; without a prior a fit begins at {begin}"
        if values.shape:
            found[path] = Parameter(path=path, value=values, unit=unit, meaning=meaning)
        sizes = _sizes(actuator, recording, name)
        for i, (own, entry) in enumerate(zip(entries_of(path, values), values.ravel(), strict=True)):
            size = sizes[i] if sizes else None
            found[own] = Parameter(path=own, value=float(entry), unit=unit, meaning=meaning, typical=size)
    return found


def _resting(actuator: AbstractActuator, recording: Recording) -> dict[str, Array]:
    """The states with which the recording begins when nothing is fitted, the imposed ones apart."""
    first = {state: _first(recording, columns) for state, columns in actuator.measured.items()}
    measured = first | {rate: jnp.zeros_like(first[base]) for rate, base in actuator.derivatives.items()}
    command = _first(recording, actuator.commands) if actuator.commands else jnp.zeros(())
    rows = {name: value[None] for name, value in measured.items()}
    track = true_track(actuator, Track(jnp.asarray(recording.step), command[None], rows))
    start = start_at_rest(actuator, track)
    states: dict[str, Array] = {name: v for name, v in start.state.items() if name != "effects"}
    effects: Mapping[str, object] = {**start.state["effects"], **start.memory}
    states |= {name: v for name, v in effects.items() if _numbers(v)}  # pyright: ignore
    return {name: value for name, value in states.items() if name not in actuator.imposed}


def _first(recording: Recording, columns: tuple[str, ...]) -> Array:
    """The first reading of each column that is a number."""
    values = [recording.columns[column] for column in columns]
    first = [float(v[np.isfinite(v)][0]) if np.isfinite(v).any() else 0.0 for v in values]
    return jnp.asarray(first[0] if len(first) == 1 else first)


def _sizes(actuator: AbstractActuator, recording: Recording, name: str) -> list[float | None]:
    """How far entries of a measured state may well be from the first reading: 1 % of the range."""
    columns = actuator.measured.get(name, ())
    return [0.01 * range_of(recording.columns[column]) or None for column in columns]


def _numbers(value: object) -> bool:
    return isinstance(value, jnp.ndarray) and jnp.issubdtype(value.dtype, jnp.floating)


def _unit(actuator: AbstractActuator, name: str) -> str:
    """Unit of a state that the rig declares; none of another, such as an effect's."""
    return actuator.states[name].unit if name in actuator.states else ""
