"""Recordings made ready to be fitted together: windows, weights, one shape for all that can share it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.estimation.missing import Mask, usable
from jaxmuscle.fitting.case import case
from jaxmuscle.fitting.problem import Problem
from jaxmuscle.recordings.recording import Recording

MOST_PADDING = 1.5
"""Work with all recordings padded to one shape, relative to the work without, up to which they share it."""


@dataclasses.dataclass(frozen=True)
class Station:
    """One recording and its part of the fit.

    Attributes:
        actuator: the machine with what is known of this recording: its load, its supply.
        recording: as it was given; `filled` has its gaps bridged.
        problem: windows, targets and weights; zero weight where nothing is known, nothing is to count, or
            a window was padded.
        period: samples of a whole window.
        spread: standard deviation of each smoothed state, sample by sample.
    """

    label: str
    actuator: AbstractActuator
    recording: Recording
    filled: Recording
    problem: Problem
    period: int
    spread: dict[str, Array]

    @property
    def samples(self) -> int:
        """Readings that count."""
        return sum(int((np.asarray(w) > 0).sum()) for w in self.problem.weights.values())

    def reweighted(self, factors: Mapping[str, NDArray[np.float64]]) -> Station:
        """With the weights of each output multiplied by a factor (one for each of its columns)."""
        weights = {
            out: w * jnp.asarray(factors[out] if w.ndim > 2 else np.ravel(factors[out])[0])
            for out, w in self.problem.weights.items()
        }
        return dataclasses.replace(self, problem=self.problem.with_weights(weights))


def station(
    actuator: AbstractActuator,
    recording: Recording,
    label: str,
    mask: Mask | None,
    noise: Mapping[str, float],
) -> Station:
    """Prepare one recording.

    Args:
        noise: column → standard deviation of its sensor (SI), in place of the card's.

    Raises:
        InputError: too little of the recording can be used.
    """
    found = usable(actuator, recording, mask)
    card = dataclasses.replace(recording.card, noise={**recording.card.noise, **noise})
    prepared = case(dataclasses.replace(found.recording, card=card), found.cut, actuator=actuator)
    problem = prepared.training
    inside = np.minimum(np.asarray(problem.rows)[:, None] + np.arange(problem.samples), len(recording) - 1)
    counts = {
        out: ~rows[inside] if problem.weights[out].ndim > 2 else ~rows[inside][..., 0]
        for out, rows in found.ignored.items()
    }
    # A sensor without any noise would leave everything to its rounding.
    weights = {
        out: jnp.where(jnp.isfinite(w), w, 0.0) * jnp.asarray(counts[out])
        for out, w in problem.weights.items()
    }
    return Station(
        label,
        actuator,
        recording,
        found.recording,
        problem.with_weights(weights),
        problem.samples,
        prepared.observed.spread,
    )


def aligned(stations: Sequence[Station]) -> list[Station]:
    """The same recordings padded to one shape, so that they share one compilation; as they are if too unlike.

    Padding repeats the last sample, and its readings have no weight.
    """
    problems = [s.problem for s in stations]
    windows = max(len(p.rows) for p in problems)
    samples = max(p.samples for p in problems)
    rows = max(p.track.command.shape[0] for p in problems)
    total = max(p.total for p in problems)
    own = sum(len(p.rows) * p.samples + p.total for p in problems)
    padded = len(problems) * (windows * samples + total)
    if padded > MOST_PADDING * own or len({p.substeps for p in problems}) > 1:
        return list(stations)
    breaks = any(p.track.begins is not None for p in problems)
    return [
        dataclasses.replace(
            s,
            problem=_padded(s.problem, windows, samples, rows, total, breaks),
            spread={name: _longer(values, rows) for name, values in s.spread.items()},
        )
        for s in stations
    ]


def _padded(problem: Problem, windows: int, samples: int, rows: int, total: int, breaks: bool) -> Problem:
    track = problem.track
    begins = track.begins
    if breaks and begins is None:
        begins = jnp.zeros(track.command.shape[0], dtype=bool)
    if begins is not None:
        begins = jnp.pad(begins, (0, rows - len(begins)))
    track = dataclasses.replace(
        track,
        command=_longer(track.command, rows),
        measured={name: _longer(values, rows) for name, values in track.measured.items()},
        begins=begins,
    )

    def filled(values: Array) -> Array:
        more = [(0, windows - values.shape[0]), (0, samples - values.shape[1])]
        return jnp.pad(values, more + [(0, 0)] * (values.ndim - 2))

    return dataclasses.replace(
        problem,
        track=track,
        rows=jnp.pad(problem.rows, (0, windows - len(problem.rows))),
        targets={out: filled(values) for out, values in problem.targets.items()},
        weights={out: filled(values) for out, values in problem.weights.items()},
        samples=samples,
        total=total,
    )


def _longer(values: Array, rows: int) -> Array:
    return jnp.pad(values, [(0, rows - values.shape[0])] + [(0, 0)] * (values.ndim - 1), mode="edge")


def in_parts(stations: Sequence[Station], parts: int) -> list[Station]:
    """Each window predicted in `parts`, each from the measured state: a smoother cost."""
    return [
        dataclasses.replace(
            s, problem=eqx.tree_at(lambda p: p.period, s.problem, jnp.asarray(-(-s.period // parts)))
        )
        for s in stations
    ]


def widened(stations: Sequence[Station], factor: float) -> list[Station]:
    """With dry friction smoothed over motions `factor` times as large."""
    return [
        dataclasses.replace(s, problem=dataclasses.replace(s.problem, widening=jnp.asarray(factor)))
        for s in stations
    ]
