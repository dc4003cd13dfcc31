"""Errors of sensors on whole runs: measured states freed of them, readings shown with them.

One mechanism for all of them: errors that a card declares, candidates of a diagnosis, and the offsets that a
fit moves. A machine that carries none goes through here without an operation.
"""

from __future__ import annotations

import dataclasses
from functools import reduce

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import KINDS, AbstractCorrectedEffect, AbstractReadingEffect, Samples
from jaxmuscle.simulation.track import Track
from jaxmuscle.units import STANDARD_ATMOSPHERE

Readings = dict[str, Array]


def without_sensor_errors(actuator: AbstractActuator) -> AbstractActuator:
    """The machine without the errors of its sensors that lie outside the chain; itself if it has none."""
    errors = [name for name, effect in actuator.effects.items() if isinstance(effect, AbstractReadingEffect)]
    return actuator.without_effects(*errors) if errors else actuator


def shown_readings(
    actuator: AbstractActuator, readings: Readings, track: Track, row: Int[Array, ""] | int
) -> Readings:
    """Readings from a row of a track on as the sensors show them.

    Args:
        readings: output → values, with a leading axis of samples.
    """
    errors = _errors(actuator)
    if not errors:
        return readings
    rows = row + jnp.arange(len(next(iter(readings.values()))))

    def shown(values: Array, column: str) -> Array:
        samples, own = _samples(actuator, column, track, rows), [e for e in errors if e.column == column]
        return reduce(lambda true, error: error.shown(true, samples), own, values)

    return {
        output: _by_column(shown, values, actuator.outputs[output])
        if {e.column for e in errors} & {*actuator.outputs[output]}
        else values
        for output, values in readings.items()
    }


def readings_now(
    actuator: AbstractActuator, readings: Readings, track: Track, row: Int[Array, ""]
) -> Readings:
    """Readings of one sample of a track as the sensors show them, without those before or after it."""
    if without_sensor_errors(actuator) is actuator:
        return readings
    series = jax.tree.map(lambda values: values[None], readings)
    return jax.tree.map(lambda values: values[0], shown_readings(actuator, series, track, row))


def true_track(actuator: AbstractActuator, track: Track) -> Track:
    """A measured track as it was in truth, freed of what the machine's sensors do to their readings.

    Rates of measured states are those of the corrected states. The track itself when no effect of the machine
    is of that kind, or when it has been freed of them.
    """
    if track.is_true:
        return track
    in_the_chain = (e for e in actuator.effects.values() if not isinstance(e, AbstractReadingEffect))
    # What came last goes first.
    effects: list[AbstractCorrectedEffect] = [*reversed(_errors(actuator))]
    effects += [effect for effect in in_the_chain if isinstance(effect, AbstractCorrectedEffect)]
    rates = {base: rate for rate, base in actuator.derivatives.items()}
    outputs = actuator.reading_slots()
    slots = {column: slot for slot, output in outputs.items() for column in actuator.outputs[output]}
    measured = dict(track.measured)
    for state, columns in actuator.measured.items() if effects else ():
        acting = [[e for e in effects if e.concerns(column, slots.get(column))] for column in columns]
        if not any(acting):
            continue
        pairs = [
            _true_column(
                own,
                _of_column(measured[state], columns, i),
                _of_column(measured[rates[state]], columns, i) if state in rates else None,
                _samples(actuator, column, track, jnp.arange(track.command.shape[0])),
            )
            for i, (own, column) in enumerate(zip(acting, columns, strict=True))
        ]
        measured[state] = _stacked([value for value, _ in pairs])
        if state in rates:
            measured[rates[state]] = _stacked([rate for _, rate in pairs])
    return dataclasses.replace(track, measured=measured, is_true=True) if effects else track


def _errors(actuator: AbstractActuator) -> list[AbstractReadingEffect]:
    """Errors of sensors in the order in which they act, that of `KINDS`, others last.

    A machine keeps its effects in no order of its own: compiled it has them by name.
    """
    order = {kind: place for place, kind in enumerate(KINDS)}
    errors = [effect for effect in actuator.effects.values() if isinstance(effect, AbstractReadingEffect)]
    return sorted(errors, key=lambda effect: (order.get(effect.kind, len(order)), effect.name))


def _true_column(
    effects: list[AbstractCorrectedEffect], values: Array, rates: Array | None, samples: Samples
) -> tuple[Array, Array]:
    """True values of one column, and their rates (zeros where none are given)."""
    if not effects:
        return values, jnp.zeros_like(values) if rates is None else rates

    if rates is None:
        true = reduce(lambda shown, effect: effect.corrected(shown, samples), effects, values)
        return true, jnp.zeros_like(true)
    return reduce(lambda shown, effect: effect.corrected_with_rate(*shown, samples), effects, (values, rates))


def _samples(actuator: AbstractActuator, column: str, track: Track, rows: Int[Array, " samples"]) -> Samples:
    """When a column's samples were taken at the rows of a track, and what its sensor calls zero."""
    first, last = jnp.asarray(0), jnp.asarray(len(rows) - 1)
    if track.begins is not None:
        index = jnp.arange(len(rows))
        begins = jnp.asarray(track.begins)[jnp.minimum(rows, len(track.begins) - 1)].at[0].set(True)
        first = jax.lax.cummax(jnp.where(begins, index, 0))
        ends = jnp.append(begins[1:], True)
        last = jax.lax.cummin(jnp.where(ends, index, len(rows) - 1), reverse=True)
    return Samples(track.time(rows), first, last, unloaded(actuator, column))


def unloaded(actuator: AbstractActuator, column: str) -> Array | float:
    """What the sensor of a column shows when nothing loads it: the ambient pressure, or zero."""
    ambient = getattr(actuator, "ambient_pressure", STANDARD_ATMOSPHERE)
    return ambient if actuator.column(column).referenced else 0.0


def _by_column(function, values: Array, columns: tuple[str, ...]) -> Array:
    return _stacked([function(_of_column(values, columns, i), name) for i, name in enumerate(columns)])


def _of_column(values: Array, columns: tuple[str, ...], place: int) -> Array:
    return values if len(columns) == 1 else values[..., place]


def _stacked(parts: list[Array]) -> Array:
    return parts[0] if len(parts) == 1 else jnp.stack(parts, axis=-1)
