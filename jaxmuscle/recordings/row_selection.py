"""Selection of rows of a recording: the stretch that is asked for, and of a long one no more than a diagnosis
holds in memory.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.units import Series

MOST_ROWS = 50_000
"""Rows of a recording that are taken unless others are asked for, so that a diagnosis stays within 4 GB: one
of a lift took up to 2.7 GB with 50,000 rows and 2.9 GB with 60,000, and one with 5,000,000 had taken 10.7 GB
when it was stopped before the end of its first fit (Python 3.13, JAX 0.12)."""
SHORTEST_STEP = 2e-3
"""Sampling step up to which a long recording is thinned out before a stretch of it is taken [s]: valves and
regulators of muscles take some milliseconds at least."""
PLACES = 10
"""Stretches that are compared, to the length of one."""
FAIR = 0.1
"""Part of a stretch that is held out, and part that is not, at least, where there are such stretches."""
NOTHING: Mapping[str, NDArray[np.bool_]] = MappingProxyType({})
ALL = "all"
EXPECTED = 'FROM:TO in seconds of its clock, such as "100:200", or "all"'


class LongRecording(UserWarning):
    """A recording has more rows than are taken of it; the message says which."""


@dataclasses.dataclass(frozen=True)
class RowRequest:
    """Which rows of a recording are asked for.

    Attributes:
        stretch: first and last instant [s]; `None` for what :data:`MOST_ROWS` allow.
        every: of how many samples one is taken; `None` for what :data:`MOST_ROWS` allow.
    """

    stretch: tuple[float, float] | None = None
    every: int | None = None

    @property
    def partial(self) -> bool:
        """Whether a stretch is asked for that is not all."""
        return self.stretch is not None and self.stretch != (-math.inf, math.inf)


def request_of(stretch: str | Sequence[float] | None, every: int | None) -> RowRequest:
    """What ``stretch=`` and ``every=`` ask for.

    Raises:
        InputError: a stretch that is none, or a number of samples below one.
    """
    if every is not None and (isinstance(every, bool) or not isinstance(every, int) or every < 1):
        raise InputError(f"every: expected a number of samples, 1 or more; got {every!r}")
    if stretch is None:
        return RowRequest(None, every)
    ends: Sequence[object] = ()
    try:
        if isinstance(stretch, str):
            ends = (-math.inf, math.inf) if stretch.strip().lower() == ALL else _ends(stretch)
        elif isinstance(stretch, Sequence):
            ends = stretch
        begin, end = (float(each) for each in ends)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"stretch: expected {EXPECTED}; got {stretch!r}") from None
    if not begin < end:
        raise InputError(f"stretch: expected {EXPECTED}, that ends after it begins; got {stretch!r}")
    return RowRequest((begin, end), every)


def _ends(text: str) -> Sequence[object]:
    parts, open_ends = text.split(":"), (-math.inf, math.inf)
    return [part.strip() or end for part, end in zip(parts, open_ends, strict=True)]


def stretch_of(time: Series, rows: RowRequest, name: object) -> slice:
    """The samples of a stretch that is asked for; all when none is.

    Raises:
        InputError: there is no sample in it.
    """
    if rows.stretch is None:
        return slice(0, len(time))
    there = np.flatnonzero((time >= rows.stretch[0]) & (time <= rows.stretch[1]))
    if there.size == 0:
        clock = f"its clock runs from {time[0]:g} s to {time[-1]:g} s" if len(time) else "it has no rows"
        begin, end = rows.stretch
        raise InputError(f"stretch: no row of {name} lies from {begin:g} s to {end:g} s; {clock}")
    return slice(int(there[0]), int(there[-1]) + 1)


@dataclasses.dataclass(frozen=True)
class Selected:
    """What was taken of a recording.

    Attributes:
        time, columns, breaks: as a :class:`~jaxmuscle.recordings.recording.Recording` has them.
        rows: which they are of those that were given.
        told: what was left out, a sentence; empty when nothing was.
        unasked: whether any of it was left out without being asked for.
    """

    time: Series
    columns: dict[str, Series]
    breaks: tuple[int, ...]
    rows: NDArray[np.intp]
    told: str
    unasked: bool


def selected(
    name: object,
    time: Series,
    columns: Mapping[str, Series],
    rows: RowRequest,
    *,
    held: Collection[str],
    largest_step: float,
    breaks: Sequence[int] = (),
    ignored: Mapping[str, NDArray[np.bool_]] = NOTHING,
    held_out: NDArray[np.bool_] | None = None,
    total: int | None = None,
) -> Selected:
    """Thin out a recording on a uniform clock, and take the stretch of it in which the signals move most.

    Of a recording of more than :data:`MOST_ROWS` rows, as many samples are passed over as the rig's step
    allows, and then :data:`MOST_ROWS` rows in a row are taken: those with the largest sum of the variances of
    all columns, each over its variance in the whole recording, without readings that are ignored; where rows
    are to be held out, among the stretches that have some of them and some others. A stretch that is asked
    for is neither shortened nor thinned out. A command becomes its mean over the samples that are passed
    over, a reading stays what the sensor read at its sample.

    Args:
        name: what the user calls the recording.
        time, columns, breaks: as they were read; the stretch that is asked for, if one is.
        rows: what is asked for.
        held: the quantities that are commands.
        largest_step: of the rig's solver [s].
        ignored: column → rows whose reading does not count.
        held_out: rows that are kept for the last word.
        total: rows before the stretch was taken, when one is asked for.
    """
    whole, step = len(time), float(time[-1] - time[0]) / max(len(time) - 1, 1)
    limited = rows.stretch is None and whole > MOST_ROWS
    every = rows.every or 1
    if limited and rows.every is None:
        every = max(1, min(int(min(largest_step, SHORTEST_STEP) / step + 1e-6), -(-whole // MOST_ROWS)))
    found, ends, kept = dict(columns), tuple(breaks), np.arange(whole)
    if every > 1:
        time, found, ends, kept = _thinned(time, found, ends, every, held)
    cut = limited and len(time) > MOST_ROWS
    if cut:
        moving = {
            key: np.where(ignored[key][kept], np.nan, values) if key in ignored else values
            for key, values in found.items()
        }
        first = _busiest(moving, MOST_ROWS, None if held_out is None else held_out[kept])
        last = first + MOST_ROWS
        found = {key: values[first:last].copy() for key, values in found.items()}
        ends = tuple(row - first for row in ends if first < row < last)
        time, kept = time[first:last].copy(), kept[first:last]
    total = total or whole
    told = _told(name, total, every, time, whole < total or cut, limited) if len(time) < total else ""
    return Selected(time, found, ends, kept, told, limited and (cut or rows.every is None))


def _thinned(
    time: Series, columns: Mapping[str, Series], breaks: Sequence[int], every: int, held: Collection[str]
) -> tuple[Series, dict[str, Series], tuple[int, ...], NDArray[np.intp]]:
    """One of `every` samples, run by run; what is left of a run at its end is left out."""
    runs = list(zip([0, *breaks], [*breaks, len(time)], strict=True))
    firsts = [np.arange(begin, end - every + 1, every) for begin, end in runs]
    kept = np.concatenate(firsts)
    if kept.size < 2:
        raise InputError(f"every: {every} leaves {kept.size} of {len(time)} rows; take fewer apart")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    clock = time[0] + every * step * np.arange(kept.size)
    found = {}
    for name, values in columns.items():
        if name in held:
            sums = np.concatenate([[0.0], np.cumsum(values)])
            found[name] = (sums[kept + every] - sums[kept]) / every
        else:
            found[name] = values[kept]
    edges = np.cumsum([rows.size for rows in firsts])[:-1]
    inner = sorted({int(row) for row in edges if 0 < row < kept.size})
    return clock, found, tuple(inner), kept


def _busiest(columns: Mapping[str, Series], length: int, held_out: NDArray[np.bool_] | None) -> int:
    """First row of the stretch of a length in which the columns move most."""
    rows = len(next(iter(columns.values())))
    starts = np.append(np.arange(0, rows - length, max(length // PLACES, 1)), rows - length)
    score = np.zeros(len(starts))
    for values in columns.values():
        there = np.isfinite(values)
        if not there.any() or np.ptp(values[there]) == 0:
            continue
        centred = np.where(there, values - values[there].mean(), 0.0)
        sums, squares = (np.concatenate([[0.0], np.cumsum(each)]) for each in (centred, centred**2))
        mean, square = ((each[starts + length] - each[starts]) / length for each in (sums, squares))
        score += (square - mean**2) / (squares[-1] / rows)
    if held_out is not None:
        sums = np.concatenate([[0], np.cumsum(held_out)])
        share = (sums[starts + length] - sums[starts]) / length
        for fair in ((share >= FAIR) & (share <= 1 - FAIR), (share > 0) & (share < 1)):
            if fair.any():
                score = np.where(fair, score, -1.0)
                break
    # Stretches that move alike differ by rounding: the first of them.
    return int(starts[np.argmax(score >= score.max() * (1 - 1e-6))])


def _told(name: object, total: int, every: int, time: Series, spanned: bool, limited: bool) -> str:
    """What was taken, a sentence."""
    thin = f"every {_ordinal(every)} sample" if every > 1 else "the samples"
    span = f" from {time[0]:.6g} s to {time[-1]:.6g} s" if spanned else ""
    busiest = " (there the signals move most)" if spanned and limited else ""
    taken = f"{name} has {total} rows, of which {len(time)} are taken: {thin}{span}{busiest}"
    if not limited:
        return f"{taken}, as asked for."
    return (
        f"{taken}, since more than {MOST_ROWS} take much memory and time; choose others with stretch "
        f'(--stretch FROM:TO, or "{ALL}") and every (--every N).'
    )


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
