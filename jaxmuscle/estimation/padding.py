"""Recordings padded to one shape, so that one compilation serves all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.estimation.stations import Station
from jaxmuscle.fitting.problem import Problem

MOST_PADDING = 1.5
"""Work with all recordings padded to one shape, relative to the work without, up to which they share it."""


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
        begins = np.zeros(track.command.shape[0], dtype=bool)
    if begins is not None:
        begins = jnp.asarray(np.pad(begins, (0, rows - len(begins))))
    track = dataclasses.replace(
        track,
        command=_longer(track.command, rows),
        measured={name: _longer(values, rows) for name, values in track.measured.items()},
        begins=begins,
    )

    def filled(values: Array) -> Array:
        more = [(0, windows - values.shape[0]), (0, samples - values.shape[1])]
        return jnp.asarray(np.pad(values, more + [(0, 0)] * (values.ndim - 2)))

    return dataclasses.replace(
        problem,
        track=track,
        rows=jnp.asarray(np.pad(problem.rows, (0, windows - len(problem.rows)))),
        targets={out: filled(values) for out, values in problem.targets.items()},
        weights={out: filled(values) for out, values in problem.weights.items()},
        samples=samples,
        total=total,
    )


def _longer(values: Array, rows: int) -> Array:
    more = [(0, rows - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return jnp.asarray(np.pad(values, more, mode="edge"))
