"""Model discrepancy in the state derivatives: the rate a state has, minus the rate that the model gives
it.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle._traced_programs import KeptProgram
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.sensing import sensed
from jaxmuscle.actuators.variables import Link, rate_unit
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.padding import longer_track
from jaxmuscle.estimation.windows import bucket
from jaxmuscle.recordings.smoothing import noise_level, smooth
from jaxmuscle.simulation import Track, held_at, observe
from jaxmuscle.simulation.sensor_errors import shown_readings, true_track

Series = NDArray[np.float64]
Arrays = dict[str, Array]


@dataclasses.dataclass(frozen=True)
class MissingRate:
    """Missing rate of the state behind each column of a link, and its standard deviation, at every sample.

    For a rig whose states are all imposed: what is missing in the reading itself.
    """

    link: Link
    values: dict[str, Series]
    spread: dict[str, Series]
    unit: str


def missing_rates(case: Case, model: AbstractActuator) -> list[MissingRate]:
    """Of every link of `model` on the whole recording, all measured states taken as measured.

    The standard deviation is that of the smoothed rate and, where the model's rate hangs on a smoothed
    derivative (a mass that sticks is held by a force that the least velocity makes), that of the latter.
    """
    track, samples = case.observed.track, case.observed.samples
    substeps = case.problem.substeps
    rates, readings = rates_and_readings(model, track, samples, substeps)
    variance = {name: np.zeros_like(values) for name, values in rates.items()}
    for name in model.derivatives:
        spread = np.asarray(case.observed.spread[name])
        shifted = (_shifted(track, name, sign * spread) for sign in (1, -1))
        up, down = (rates_and_readings(model, other, samples, substeps)[0] for other in shifted)
        variance = {n: v + (0.5 * (up[n] - down[n])) ** 2 for n, v in variance.items()}
    return [_of_link(case, model, link, rates, readings, variance) for link in model.links]


def _shifted(track: Track, name: str, shift: Series) -> Track:
    moved = jnp.asarray(np.asarray(track.measured[name]) + shift)
    return eqx.tree_at(lambda t: t.measured, track, {**track.measured, name: moved})


def rates_and_readings(
    model: AbstractActuator, track: Track, samples: int, substeps: int
) -> tuple[dict[str, Series], dict[str, Series]]:
    """Rates of the measured states, and readings, that `model` gives at every sample of a measured track."""
    rows = bucket(samples)
    found = _rates_and_readings(model, longer_track(track, rows, False), rows, substeps)
    rates, readings = ({name: np.asarray(v)[:samples] for name, v in each.items()} for each in found)  # pyright: ignore
    return rates, readings


@KeptProgram
def _rates_and_readings(
    model: AbstractActuator, track: Track, samples: int, substeps: int
) -> tuple[Arrays, Arrays]:
    track = true_track(model, track)
    hidden = observe(model, track, samples, substeps)

    def instant(row, start):
        state = {**start.state, **track.at(row)}
        held = held_at(model, track, row, start.memory)
        states = {**state.get("effects", {}), **start.memory}
        return model.vector_field(state, held), sensed(model, model.signals(state, held), states)

    rates, readings = jax.vmap(instant)(jnp.arange(samples), hidden)
    readings = shown_readings(model, readings, track, 0)
    return {name: rates[name] for name in (*model.measured, *model.derivatives)}, readings


def _of_link(
    case: Case,
    model: AbstractActuator,
    link: Link,
    rates: dict[str, Series],
    readings: dict[str, Series],
    variance: dict[str, Series],
) -> MissingRate:
    columns, step = case.filled.columns, case.recording.step
    names = model.outputs[link.output]
    unit = model.column(names[0]).unit
    values, spread = {}, {}
    if link.output not in model.measured:
        for name, modelled in _by_column(names, readings[link.output]).items():
            values[name] = columns[name] - modelled
            spread[name] = np.full_like(
                modelled, case.recording.card.noise.get(name) or noise_level(columns[name])
            )
        return MissingRate(link, values, spread, unit)
    state = next((d for d, base in model.derivatives.items() if base == link.output), link.output)
    order = 1 if state == link.output else 2
    for name, modelled in _by_column(names, rates[state]).items():
        estimate, own = smooth(columns[name], step, noise_level(columns[name]), order)
        values[name] = estimate - modelled
        spread[name] = np.hypot(own, np.sqrt(_by_column(names, variance[state])[name]))
    return MissingRate(link, values, spread, rate_unit(unit) if order == 1 else rate_unit(rate_unit(unit)))


def _by_column(names: tuple[str, ...], values: Series) -> dict[str, Series]:
    table = values.reshape(len(values), -1)
    return {name: table[:, i] for i, name in enumerate(names)}
