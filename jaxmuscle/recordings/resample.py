"""From an irregular clock to a uniform one."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from jaxmuscle.recordings.units import Series


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
    return clock, {
        name: _mean_of_held(time, values, clock, step) if name in held else np.interp(clock, time, values)
        for name, values in columns.items()
    }


def _mean_of_held(time: Series, values: Series, clock: Series, step: float) -> Series:
    """Mean over [t, t + step) of a signal that keeps each value until the next; the last one lasts."""
    ends = np.append(time, clock[-1] + step)
    integral = np.concatenate([[0.0], np.cumsum(values * np.diff(ends))])
    edges = np.append(clock, clock[-1] + step)
    return np.diff(np.interp(edges, ends, integral)) / step
