"""Padding of recordings to common shapes, so that they share compiled programs.

What depends on the length of a recording in a compiled program: rows of the track, rows that the observer
runs over (`total`), number of windows, and samples of a window where no horizon fixes them. Padding repeats
the last row, adds windows that begin at row 0 and samples that run on; none of them has any weight. It is
done for every evaluation, by NumPy: half a millisecond, where JAX takes three.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.estimation.windows import Problem
from jaxmuscle.simulation import Track

FACTOR = 1.25
"""Ratio of two sizes that follow each other: an eighth of a program's work is padding on average."""


def bucket(size: int) -> int:
    """The smallest size of the series 1, 2, 3, 4, 5, 7, 9, 12, 15, … that is not less than `size`."""
    found = 1
    while found < size:
        found = max(found + 1, math.ceil(FACTOR * found))
    return found


SLACK = 0.01
"""Part of a recording by which windows may reach further than its share: a share is rounded to that."""


def in_buckets(problem: Problem) -> Problem:
    """The same problem in sizes that recordings of similar lengths have in common.

    All of them follow from the number of rows, so that two recordings share all or none: rows in the series,
    the observer's rows as the same share of them, windows as many as these hold and one for what a break
    cuts off. The length of windows is left as it is where a horizon fixes it for every recording. Residuals
    are those of `problem` in its windows and samples, see :func:`without_padding`; the others count for
    nothing.
    """
    own, samples = problem.track.command.shape[0], problem.samples
    rows = bucket(own)
    used = math.ceil((problem.share + SLACK) * rows)
    if problem.fixed:
        more = len(problem.rows) - math.ceil(problem.share * own / samples)
        windows = math.ceil(used / samples) + bucket(max(more, 1))
    else:
        samples, windows = bucket(samples), bucket(len(problem.rows))
    total = max(problem.total, min(rows, used + samples))
    windows = max(windows, len(problem.rows))
    breaks = problem.track.begins is not None
    return padded(problem, windows=windows, samples=samples, rows=rows, total=total, breaks=breaks)


def without_padding(values: Mapping[str, Array], problem: Problem) -> dict[str, NDArray[np.float64]]:
    """What belongs to the windows and samples of `problem`, of values computed for it :func:`in_buckets`.

    Args:
        values: output → array whose first axes are windows and samples.
    """
    own = slice(len(problem.rows)), slice(problem.samples)
    return {output: np.asarray(array)[own] for output, array in values.items()}


def vector_without_padding(
    values: Float[np.ndarray, "... n"], outputs: Iterable[str], problem: Problem, common: Problem
) -> Float[np.ndarray, "... m"]:
    """The same of the residuals of all `outputs`, one after the other along the last axis.

    Args:
        common: `problem` :func:`in_buckets`.
    """
    found, begin = [], 0
    for output in outputs:
        shape = common.weights[output].shape
        size = math.prod(shape)
        part = values[..., begin : begin + size].reshape(*values.shape[:-1], shape[0], shape[1], -1)
        own = part[..., : len(problem.rows), : problem.samples, :]
        found.append(own.reshape(*values.shape[:-1], -1))
        begin += size
    return np.concatenate(found, axis=-1)


def padded(problem: Problem, *, windows: int, samples: int, rows: int, total: int, breaks: bool) -> Problem:
    """A problem padded to given sizes, none less than its own.

    Args:
        rows: of the track.
        total: rows over which the states that are not measured are carried along.
        breaks: whether the track says where stretches begin, as that of another recording does.
    """

    def filled(values: Array) -> NDArray[np.float64]:
        more = [(0, windows - values.shape[0]), (0, samples - values.shape[1])]
        return np.pad(values, more + [(0, 0)] * (values.ndim - 2))

    return dataclasses.replace(
        problem,
        track=longer_track(problem.track, rows, breaks),
        rows=np.pad(problem.rows, (0, windows - len(problem.rows))),
        targets={out: filled(values) for out, values in problem.targets.items()},
        weights={out: filled(values) for out, values in problem.weights.items()},
        samples=samples,
        total=total,
    )


def longer_track(track: Track, rows: int, breaks: bool) -> Track:
    """A track whose last row is repeated up to `rows`; `breaks`: as of :func:`padded`."""
    begins = track.begins
    if breaks and begins is None:
        begins = np.zeros(track.command.shape[0], dtype=bool)
    if begins is not None:
        begins = np.pad(begins, (0, rows - len(begins)))
    return dataclasses.replace(
        track,
        command=longer(track.command, rows),
        measured={name: longer(values, rows) for name, values in track.measured.items()},
        begins=begins,
    )


def longer(values: Array, rows: int) -> NDArray[np.float64]:
    """Values along a recording, the last one repeated up to `rows`."""
    more = [(0, rows - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, more, mode="edge")
