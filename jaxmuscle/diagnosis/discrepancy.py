"""Model discrepancy in the state derivatives: the rate a state has, minus the rate that the model gives
it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle._traced_programs import KeptProgram
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.sensing import sensed
from jaxmuscle.actuators.variables import Link, rate_unit
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.free_parameters import Unknowns, moved_machine
from jaxmuscle.estimation.padding import longer_track
from jaxmuscle.estimation.windows import bucket
from jaxmuscle.recordings.smoothing import noise_level, smooth
from jaxmuscle.simulation import Track, held_at, observe
from jaxmuscle.simulation.sensor_errors import shown_readings, true_track
from jaxmuscle.simulation.track import machine_at

Series = NDArray[np.float64]
Slopes = Mapping[str, Float[np.ndarray, "rows k"]]
"""Column → derivatives of its missing rate by the coordinates of k free parameters, at every sample."""
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


DIFFERENCE = 1e-4
"""Step of a difference quotient, in coordinates."""
ROUNDING = 1e-11
"""Part of the largest rate of a column up to which a change is none, but rounding."""


def rate_slopes(case: Case, model: AbstractActuator, unknowns: Unknowns) -> list[Slopes]:
    """Derivatives of :func:`missing_rates`, of every link, by the free parameters of a fitted model."""

    def modelled(machine: AbstractActuator) -> list[dict[str, Series]]:
        found = rates_and_readings(machine, case.observed.track, case.observed.samples, case.problem.substeps)
        return [_modelled(machine, link, *found) for link in machine.links]

    here, point = modelled(model), unknowns.coordinates(unknowns.start)
    steps = np.diag(np.where(point + DIFFERENCE > unknowns.upper, -DIFFERENCE, DIFFERENCE))
    moved = [(step, modelled(moved_machine(model, unknowns, point + step, 0))) for step in steps]

    def slope(values: Series, there: Series, step: float) -> Series:
        change = there - values
        moves = np.abs(change).max() > ROUNDING * np.abs(values).max()
        return -change / step if moves else np.zeros_like(values)

    return [
        {
            column: np.array([slope(values, there[i][column], step.sum()) for step, there in moved])
            .reshape(len(moved), len(values))
            .T
            for column, values in link.items()
        }
        for i, link in enumerate(here)
    ]


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
        here = machine_at(model, track, row)
        return here.vector_field(state, held), sensed(here, here.signals(state, held), states)

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
        for name, modelled in _modelled(model, link, rates, readings).items():
            values[name] = columns[name] - modelled
            spread[name] = np.full_like(
                modelled, case.recording.card.noise.get(name) or noise_level(columns[name])
            )
        return MissingRate(link, values, spread, unit)
    state = _rate_state(model, link)
    order = 1 if state == link.output else 2
    for name, modelled in _modelled(model, link, rates, readings).items():
        estimate, own = smooth(columns[name], step, noise_level(columns[name]), order)
        values[name] = estimate - modelled
        spread[name] = np.hypot(own, np.sqrt(_by_column(names, variance[state])[name]))
    return MissingRate(link, values, spread, rate_unit(unit) if order == 1 else rate_unit(rate_unit(unit)))


def _rate_state(model: AbstractActuator, link: Link) -> str:
    """The state behind a measured output whose rate the model gives: its velocity, if it has one."""
    return next((d for d, base in model.derivatives.items() if base == link.output), link.output)


def _modelled(
    model: AbstractActuator, link: Link, rates: dict[str, Series], readings: dict[str, Series]
) -> dict[str, Series]:
    """What a model gives for each column of a link: the rate of the state behind it, or the reading."""
    integrated = link.output in model.measured
    values = rates[_rate_state(model, link)] if integrated else readings[link.output]
    return _by_column(model.outputs[link.output], values)


def _by_column(names: tuple[str, ...], values: Series) -> dict[str, Series]:
    table = values.reshape(len(values), -1)
    return {name: table[:, i] for i, name in enumerate(names)}
