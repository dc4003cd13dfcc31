"""What is missing at each instant: the rate a state has, minus the rate that the model gives it."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator, Held, Link
from jaxmuscle.fitting.case import Case
from jaxmuscle.recordings.smooth import noise_level, smooth
from jaxmuscle.recordings.units import column_unit
from jaxmuscle.signals import Past
from jaxmuscle.simulation import Track, observe

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
    """Of every link of `model` on the whole recording, all measured states taken as measured."""
    rates, readings = _evaluate(model, case.observed.track, case.observed.samples)
    return [_of_link(case, model, link, rates, readings) for link in model.links]


@eqx.filter_jit
def _evaluate(model: AbstractActuator, track: Track, samples: int):
    hidden = observe(model, track, samples)

    def instant(row, start):
        state = {**start.state, **track.at(row)}
        past = Past(track.command, row, track.step, track.first(row)) if model.commands else None
        held = Held(track.command[row], past, start.memory)
        signals = model.signals(state, held)
        return model.vector_field(state, held), model.readings(signals)

    rates, readings = jax.vmap(instant)(jnp.arange(samples), hidden)
    return {name: rates[name] for name in (*model.measured, *model.derivatives)}, readings


def _of_link(case: Case, model: AbstractActuator, link: Link, rates: Arrays, readings: Arrays) -> MissingRate:
    columns, step = case.recording.columns, case.recording.step
    names = model.outputs[link.output]
    unit = column_unit(names[0], model.units.get("command", ""))
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
        estimate, spread[name] = smooth(columns[name], step, noise_level(columns[name]), order)
        values[name] = estimate - modelled
    return MissingRate(link, values, spread, f"{unit}/s" if order == 1 else f"{unit}/s^2")


def _by_column(names: tuple[str, ...], values: Array) -> dict[str, Series]:
    table = np.asarray(values).reshape(len(values), -1)
    return {name: table[:, i] for i, name in enumerate(names)}
