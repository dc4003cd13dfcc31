"""Padding of recordings to common shapes, so that they share compiled programs.

What depends on the length of a recording in a compiled program: rows of the track, rows that the observer
runs over (`total`), number of windows, and samples of a window where no horizon fixes them. Padding repeats
the last row, adds windows that begin at row 0 and samples that run on; none of them has any weight.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.windows import Problem

FACTOR = 1.25
"""Ratio of two sizes that follow each other: an eighth of a program's work is padding on average."""


def bucket(size: int) -> int:
    """The smallest size of the series 1, 2, 3, 4, 5, 7, 9, 12, 15, … that is not less than `size`."""
    found = 1
    while found < size:
        found = max(found + 1, math.ceil(FACTOR * found))
    return found


def in_buckets(problem: Problem, *, keep_samples: bool = False) -> Problem:
    """The same problem in sizes of the series.

    Its residuals are those of `problem` in the first windows and samples, see :func:`without_padding`; the
    others count for nothing. Statistics that count windows or samples (degrees of freedom, blocks, folds)
    take the problem as it was.

    Args:
        keep_samples: leave the length of windows as it is, where a horizon fixes it for every recording.
    """
    return padded(
        problem,
        windows=bucket(len(problem.rows)),
        samples=problem.samples if keep_samples else bucket(problem.samples),
        rows=bucket(problem.track.command.shape[0]),
        total=bucket(problem.total),
        breaks=problem.track.begins is not None,
    )


def without_padding(
    values: Mapping[str, Array], problem: Problem, axis: int = 0
) -> dict[str, NDArray[np.float64]]:
    """What belongs to the windows and samples of `problem`, of values computed for it :func:`in_buckets`.

    Args:
        values: output → array whose axes `axis` and `axis` + 1 are windows and samples.
    """
    own = (*[slice(None)] * axis, slice(len(problem.rows)), slice(problem.samples))
    return {output: np.asarray(array)[own] for output, array in values.items()}


def padded(problem: Problem, *, windows: int, samples: int, rows: int, total: int, breaks: bool) -> Problem:
    """A problem padded to given sizes, none less than its own.

    Args:
        rows: of the track.
        total: rows over which the states that are not measured are carried along.
        breaks: whether the track says where stretches begin, as that of another recording does.
    """
    track = problem.track
    begins = track.begins
    if breaks and begins is None:
        begins = np.zeros(track.command.shape[0], dtype=bool)
    if begins is not None:
        begins = jnp.asarray(np.pad(begins, (0, rows - len(begins))))
    track = dataclasses.replace(
        track,
        command=longer(track.command, rows),
        measured={name: longer(values, rows) for name, values in track.measured.items()},
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


def longer(values: Array, rows: int) -> Array:
    """Values along a recording, the last one repeated up to `rows`."""
    more = [(0, rows - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return jnp.asarray(np.pad(values, more, mode="edge"))


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
    work = len(problems) * (windows * samples + total)
    if work > MOST_PADDING * own or len({p.substeps for p in problems}) > 1:
        return list(stations)
    breaks = any(p.track.begins is not None for p in problems)
    return [
        dataclasses.replace(
            s,
            problem=padded(
                s.problem, windows=windows, samples=samples, rows=rows, total=total, breaks=breaks
            ),
            spread={name: longer(values, rows) for name, values in s.spread.items()},
        )
        for s in stations
    ]
