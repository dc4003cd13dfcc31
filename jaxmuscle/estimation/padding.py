"""Padding of recordings to common shapes, so that they share compiled programs.

What depends on the length of a recording in a compiled program: rows of the track, rows that the observer
runs over (`total`), number of windows, and samples of a window that is a whole stretch. Padding repeats
the last row, adds windows that begin at row 0 and samples that run on; none of them has any weight. It is
done for every evaluation, by NumPy: half a millisecond, where JAX takes three.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping

import jax
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from jaxmuscle.estimation.windows import Problem, bucket
from jaxmuscle.simulation import Track

SLACK = 0.01
"""Part of a recording by which windows may reach further than its share: a share is rounded to that."""


def in_buckets(problem: Problem, whole: bool = False) -> Problem:
    """The same problem in sizes that recordings of similar lengths have in common.

    All of them follow from the number of rows, so that two recordings share all or none: rows in the series,
    the observer's rows as the same share of them, windows as many as these hold and more for what breaks
    cut off (one more or less of these makes a difference). The length of windows is left as it is unless it
    is that of the recording. Residuals are those of `problem` in its windows and samples, see
    :func:`without_padding`; the others count for nothing.

    Args:
        whole: as if all rows lay in windows: a part of a recording, such as the windows that a fit may see,
            then shares the sizes of the whole.
    """
    own = problem.track.command.shape[0]
    rows = bucket(own)
    share = 1.0 if whole else problem.share
    used = math.ceil((share + SLACK) * rows)
    samples = problem.samples if problem.fixed else bucket(problem.samples)
    windows = bucket(len(problem.rows))
    if problem.fixed:
        more = len(problem.rows) - math.ceil(problem.share * own / samples)
        windows = max(len(problem.rows), math.ceil(used / samples) + (bucket(more) if more > 0 else 0))
        # The whole has a few windows more that breaks cut off than its part.
        windows = bucket(windows) if whole else windows
    total = max(problem.total, min(rows, used + samples))
    breaks = problem.track.begins is not None
    common = padded(problem, windows=windows, samples=samples, rows=rows, total=total, breaks=breaks)
    return dataclasses.replace(common, share=share)


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
        windows, samples, *muscles = common.weights[output].shape
        columns = math.prod(muscles)
        end = begin + windows * samples * columns
        part = values[..., begin:end].reshape(*values.shape[:-1], windows, samples, columns)
        own = part[..., : len(problem.rows), : problem.samples, :]
        found.append(own.reshape(*values.shape[:-1], math.prod(own.shape[-3:])))
        begin = end
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
        differences={name: longer(values, rows) for name, values in track.differences.items()},
        start_errors=jax.tree.map(lambda values: longer(values, rows), track.start_errors),
    )


def longer(values: Array, rows: int) -> NDArray[np.float64]:
    """Values along a recording, the last one repeated up to `rows`."""
    more = [(0, rows - values.shape[0])] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, more, mode="edge")
