"""A recording prepared for a machine: the track of a run, with smoothed states and their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.recordings.smoothing import noise_level, rate_from_past, smooth
from jaxmuscle.simulation.track import StartError, Track

Columns = Mapping[str, NDArray[np.float64]]
Pair = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Values and their standard deviations, sample by sample."""

ENOUGH = 50
"""Samples from which the noise of a stretch can be told."""


@runtime_checkable
class Sampled(Protocol):
    """What is needed of a recording."""

    @property
    def step(self) -> float: ...
    @property
    def columns(self) -> Columns: ...
    @property
    def breaks(self) -> tuple[int, ...]: ...
    @property
    def differences(self) -> Columns: ...


class Observed(eqx.Module):
    """A recording prepared for a machine.

    Attributes:
        track: commands and smoothed measured states.
        spread: standard deviation of each smoothed state, sample by sample.
        outputs: reading → raw measured values.
        noise: reading → standard deviation of its sensor.
    """

    track: Track
    spread: dict[str, Float[Array, "samples ..."]]
    outputs: dict[str, Float[Array, "samples ..."]]
    noise: dict[str, Float[Array, "..."]]

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.track.command.shape[0]


def observed(
    actuator: AbstractActuator,
    recording: Sampled,
    noise: Mapping[str, float],
    cuts: tuple[int, ...] = (),
    twice: bool = False,
) -> Observed:
    """Prepare `recording` for `actuator`.

    Args:
        noise: column → standard deviation of its sensor (SI); a column without one gets the level that
            :func:`noise_level` finds in the data.
        cuts: further rows, besides the recording's breaks, across which nothing is smoothed.
        twice: smooth signals twice, which leaves their peaks, see :func:`smooth`.
    """
    columns, step, edges = recording.columns, recording.step, _edges(recording, cuts)
    samples = edges[-1]

    def smoothed(column: str, derivative: int) -> Pair:
        return _by_stretches(
            columns[column], edges, lambda values, noise: smooth(values, step, noise, derivative, twice)
        )

    measured, spread = {}, {}
    for state, names in actuator.measured.items():
        measured[state], spread[state] = _pair(names, lambda name: smoothed(name, 0))
    for state, base in actuator.derivatives.items():
        measured[state], spread[state] = _pair(actuator.measured[base], lambda name: smoothed(name, 1))
    command = (
        _stack(actuator.commands, lambda name: columns[name]) if actuator.commands else np.zeros(samples)
    )
    outputs = {out: _stack(names, lambda n: columns[n]) for out, names in actuator.outputs.items()}
    levels = {
        out: _stack(names, lambda n: np.asarray(noise.get(n) or _longest_level(columns[n], edges)))
        for out, names in actuator.outputs.items()
    }
    as_arrays = lambda tree: {name: jnp.asarray(values) for name, values in tree.items()}  # noqa: E731
    begins = jnp.asarray(np.isin(np.arange(samples), recording.breaks)) if recording.breaks else None
    track = Track(
        jnp.asarray(step),
        jnp.asarray(command),
        as_arrays(measured),
        begins,
        differences=as_arrays(differences_by_path(actuator, recording)),
    )
    return Observed(track, as_arrays(spread), as_arrays(outputs), as_arrays(levels))


def differences_by_path(actuator: AbstractActuator, recording: Sampled) -> Columns:
    """What differs between parts of a recording, by the paths at which the machine has these quantities.

    Raises:
        InputError: the machine has no such quantity.
    """
    strange = sorted(set(recording.differences) - set(actuator.quantities))
    if strange:
        raise InputError(
            f"parts of the recording differ in {', '.join(strange)}, and rig '{actuator.rig}' has no such "
            "quantity; simulate each part by itself, or add it to the `quantities` of the rig"
        )
    return {actuator.quantities[name]: by for name, by in recording.differences.items()}


def begun_from_past(
    prepared: Observed, actuator: AbstractActuator, recording: Sampled, cuts: tuple[int, ...] = ()
) -> Observed:
    """`prepared` with runs that begin with states as samples up to then tell them.

    A measured state is its reading, with the noise found in it; its rate that of
    :func:`~jaxmuscle.recordings.smoothing.rate_from_past`. Inputs of links, and states that the bench imposes
    throughout, stay smoothed from both sides: a prediction is told them.

    Args:
        recording, cuts: as of :func:`observed`.
    """
    columns, step, edges = recording.columns, recording.step, _edges(recording, cuts)

    def read(values: NDArray, noise: float) -> Pair:
        return values, np.full(len(values), noise)

    def rate(values: NDArray, noise: float) -> Pair:
        return rate_from_past(values, step, noise)

    errors, bases = {}, {**{state: state for state in actuator.measured}, **actuator.derivatives}
    for state in (name for name in bases if name not in actuator.imposed):
        known = rate if state in actuator.derivatives else read
        names = actuator.measured[bases[state]]
        found = {name: _by_stretches(columns[name], edges, known) for name in names}
        values, spread = _pair(names, found.__getitem__)
        offset = values - np.asarray(prepared.track.measured[state])
        errors[state] = StartError(jnp.asarray(offset), jnp.asarray(spread))
    return eqx.tree_at(lambda p: p.track.start_errors, prepared, errors)


def _edges(recording: Sampled, cuts: tuple[int, ...]) -> list[int]:
    """Rows between which nothing is smoothed across, the first and the end among them."""
    samples = len(next(iter(recording.columns.values())))
    return sorted({0, *recording.breaks, *cuts, samples})


def _by_stretches(column: NDArray, edges: list[int], estimate: Callable[[NDArray, float], Pair]) -> Pair:
    """What `estimate` makes of each stretch of a column and of its noise, one after the other."""
    stretches = [column[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    parts = [estimate(values, _level(values, stretches)) for values in stretches]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _level(values: NDArray, stretches: list[NDArray]) -> float:
    """Noise of one stretch by its own samples, so that none learns of another; or the longest's."""
    enough = len(values) >= ENOUGH
    return noise_level(values if enough else max(stretches, key=len))


def _longest_level(values: NDArray, edges: list[int]) -> float:
    """Noise of the longest stretch: the held-out rows, which are fewer, have no say in a weight."""
    return noise_level(max((values[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)), key=len))


def _stack(names: tuple[str, ...], of: Callable[[str], NDArray]) -> NDArray:
    """One column as it is, several side by side."""
    parts = [of(name) for name in names]
    return parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)


def _pair(names: tuple[str, ...], of: Callable[[str], Pair]) -> Pair:
    """Values and deviations of one column, or of several side by side."""
    pairs = {name: of(name) for name in names}
    return _stack(names, lambda name: pairs[name][0]), _stack(names, lambda name: pairs[name][1])
