"""Clocks: time stamps as seconds, signals of several clocks on one, and an irregular clock made uniform."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jaxmuscle.errors import InputError
from jaxmuscle.recordings.table import Table
from jaxmuscle.units import Series

STAMP = re.compile(r"\d{4}-?\d\d-?\d\d[T ]\d\d(:?\d\d(:?\d\d([.,]\d{1,9})?)?)?( ?(Z|[+-]\d\d(:?\d\d)?))?")
"""A date with a time of day as ISO 8601 has it."""
TIME_OF_DAY = re.compile(r"\d{1,2}:\d\d(:\d\d([.,]\d{1,9})?)?")
HALF_A_DAY = pd.Timedelta(hours=12)
LONGEST_GAP = 20
"""Longest gap that is bridged by interpolation, in sampling steps."""


def is_stamp(text: str) -> bool:
    """Whether a text is an ISO date with a time, or a time of day, ``12:00:00.5``."""
    return bool(STAMP.fullmatch(text) or TIME_OF_DAY.fullmatch(text))


def holds_stamps(entries: Any) -> bool:
    """Whether a column holds dates or durations, or ISO texts of them, by the first that is not empty."""
    kind = entries.dtype if isinstance(entries, pd.Series) else np.asarray(entries[:1]).dtype
    if pd.api.types.is_numeric_dtype(kind):
        return False
    first = pd.Series(entries).dropna().head(1).tolist()
    return bool(first) and (is_stamp(first[0].strip()) if isinstance(first[0], str) else _is_date(first[0]))


def stamps_to_seconds(table: Table, column: str, zero: str | None = None) -> Series:
    """Seconds since the first stamp of a column of dates, durations or ISO texts.

    Args:
        table, column: where they stand.
        zero: column whose first stamp is taken instead.

    Raises:
        InputError: the first row that is no stamp; stamps of another kind than those of `zero`.
    """
    found = _stamps(table, column)
    first = found.iloc[0] if zero is None else _stamps(table, zero).iloc[0]
    if isinstance(first, pd.Timedelta) != pd.api.types.is_timedelta64_dtype(found.dtype):
        raise InputError(
            f"has dates where {zero!r} has times of day, or the other way round; write both alike"
        )
    return np.asarray((found - first).dt.total_seconds(), dtype=float)


def _stamps(table: Table, column: str) -> pd.Series:
    """A column as dates in UTC, or as durations."""
    series = pd.Series(table.columns[column]).reset_index(drop=True)
    found = series if _is_dates(series.dtype) else _parsed(series)
    bad = np.flatnonzero(found.isna())
    if bad.size:
        got, count = repr(series.iloc[bad[0]]), "" if bad.size == 1 else f" ({bad.size} such rows)"
        raise InputError(
            f"row {table.row(bad[0])}: expected a time stamp as in the rows before, such as "
            f"2026-03-01T12:00:00.125; got {got}{count}; mend or cut out such rows"
        )
    if pd.api.types.is_timedelta64_dtype(found.dtype):
        return found
    return found.dt.tz_localize("UTC") if found.dt.tz is None else found.dt.tz_convert("UTC")


def _parsed(series: pd.Series) -> pd.Series:
    """Dates of their texts, or durations of times of day; NaT where there is none."""
    texts = series.map(lambda entry: entry.strip().replace(",", ".") if isinstance(entry, str) else entry)
    first = texts.dropna().iloc[0]
    if isinstance(first, str) and TIME_OF_DAY.fullmatch(first):
        whole = texts.map(lambda text: f"{text}:00" if str(text).count(":") == 1 else text)
        return _over_midnight(pd.Series(pd.to_timedelta(whole, errors="coerce")))
    form = "ISO8601" if isinstance(first, str) else None
    return pd.Series(pd.to_datetime(texts, errors="coerce", utc=True, format=form))


def _over_midnight(of_day: pd.Series) -> pd.Series:
    """Times of day as durations that go on where a new day begins."""
    days = (of_day.diff() < -HALF_A_DAY).cumsum()
    return of_day + days * pd.Timedelta(days=1)


def _is_dates(dtype: Any) -> bool:
    return pd.api.types.is_datetime64_any_dtype(dtype) or pd.api.types.is_timedelta64_dtype(dtype)


def _is_date(entry: Any) -> bool:
    return hasattr(entry, "isoformat") or isinstance(entry, np.datetime64 | np.timedelta64)


def on_clock(time: Series, own: Series, values: Series, *, held: bool) -> NDArray[np.float64]:
    """Samples taken at the instants `own`, at the instants `time`.

    A measured signal is interpolated linearly; it is NaN before its first sample, after its last one and in
    gaps of more than :data:`LONGEST_GAP` of its steps. A command that is held from its sample to the next
    becomes its mean from an instant to the next; it is NaN before its first sample, and the last one lasts.

    Args:
        time, own: increasing [s].
        values: at `own`; NaN where there is none, which is then left out.
        held: whether it is a command.
    """
    there = np.isfinite(values) & np.isfinite(own)
    own, values = own[there], values[there]
    if own.size == 0:
        return np.full(time.shape, np.nan)
    # Instants that two clocks share differ by rounding.
    rounding = 1e-6 * float(np.median(np.diff(own))) if own.size > 1 else 0.0
    early = time < own[0] - rounding
    if held:
        last = float(np.median(np.diff(time))) if time.size > 1 else 0.0
        found = mean_of_held(own, values, np.append(time, time[-1] + last))
        return np.where(early, np.nan, found)
    found = np.interp(time, own, values)
    found[early | (time > own[-1] + rounding)] = np.nan
    gaps = np.diff(own)
    if gaps.size:
        for i in np.flatnonzero(gaps > LONGEST_GAP * np.median(gaps)):
            found[(time > own[i] + rounding) & (time < own[i + 1] - rounding)] = np.nan
    return found


def resampled(
    time: Series, columns: Mapping[str, Series], held: Collection[str]
) -> tuple[Series, dict[str, Series]]:
    """(time, columns) on a uniform clock with the median step, from the first sample on.

    Measured columns are interpolated linearly. A command acts from its sample to the next, so its new
    value is the mean of the held command over the new interval, which neither delays nor advances it.

    Args:
        time: increasing [s].
        columns: quantity → samples.
        held: the quantities that are commands.
    """
    step = float(np.median(np.diff(time)))
    # The small addition keeps the last sample when the clock is uniform up to rounding.
    clock = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    edges = np.append(clock, clock[-1] + step)
    return clock, {
        name: mean_of_held(time, values, edges) if name in held else np.interp(clock, time, values)
        for name, values in columns.items()
    }


def mean_of_held(time: Series, values: Series, edges: Series) -> Series:
    """Mean from each of `edges` to the next of a signal that keeps each value; the last lasts."""
    ends = np.append(time, max(edges[-1], time[-1]))
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
    return np.diff(np.interp(edges, ends, integral)) / np.diff(edges)
