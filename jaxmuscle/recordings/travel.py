"""Whether a muscle can have moved as its recording says: its braid lets it go only so far."""

from __future__ import annotations

import numpy as np

from jaxmuscle.recordings.bench import Bench
from jaxmuscle.recordings.muscle_limits import MuscleLimits

ELSEWHERE = "another column"
LITTLE_TRAVEL = 10.0
"""Ratio of the contraction by [T] at the pressures measured to the largest one measured, at most."""


def check_contraction(bench: Bench, muscle: MuscleLimits) -> None:
    """Hold the position between a taut braid, or the base plate, and the contraction without force."""
    (position,) = bench.checked("lift") or bench.checked("contraction")
    low = -muscle.offset if bench.checked("lift") else -muscle.largest_extension
    high = muscle.largest_contraction
    values = bench.columns[position]
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    if low <= least and most <= high:
        return
    at = int(np.nanargmin(values)) if least < low else int(np.nanargmax(values))
    show = lambda value: bench.shown(position, value)  # noqa: E731
    what = (
        f"{show(float(values[at]))} of contraction in {bench.row(at)} cannot be: expected {show(low)} to "
        f"{show(high)} of a muscle of {show(muscle.initial_length)}"
    )
    if low <= -most and -least <= high:
        bench.add(position, f"{what}, shortening being positive", "of the opposite sign")
    elif most - least <= high - low:
        bench.add(position, f"{what}, from its full length on", "of another zero", ELSEWHERE)
    else:
        largest = max(abs(least), abs(most))
        in_reach = bench.units_of_column(position, largest, lambda x: 0.03 * high <= x <= high)
        long = lambda l0: largest <= high / muscle.initial_length * l0 <= 30 * largest  # noqa: E731
        bench.add(position, what, in_reach, bench.units_of_quantity("initial_length", long), ELSEWHERE)


def check_rise(bench: Bench, muscle: MuscleLimits, weight: float) -> None:
    """A mass that a quarter of the samples hold high by their pressure is not hardly off its plate."""
    (position,), (of_pressure,) = bench.checked("lift"), bench.checked("muscle pressure")
    pressure = float(np.nanquantile(bench.gauge(of_pressure), 0.75))
    expected = muscle.carrying_contraction(weight, pressure)
    most = bench.most(position)
    if expected < 0.1 * muscle.largest_contraction or most * LITTLE_TRAVEL > expected:
        return
    fits = lambda x: expected / 3 < x <= muscle.largest_contraction  # noqa: E731
    long = lambda l0: most / 3 < expected / muscle.initial_length * l0 < 3 * most  # noqa: E731
    bench.add(
        position,
        f"at most {bench.shown(position, most)} of contraction, where this muscle under this load shortens "
        f"by {bench.shown(position, expected)} at the {bench.shown(of_pressure, pressure)} gauge that a "
        f"quarter of the samples exceed",
        bench.units_of_column(position, most, fits) if most > 0 else "",
        bench.units_of_quantity("initial_length", long),
        ELSEWHERE,
    )


def check_angles(bench: Bench, muscle: MuscleLimits) -> None:
    """Hold the muscles of a joint to what their braid allows: x = ε0 l0 ± R θ."""
    radius, ratio = bench.value("sprocket_radius"), bench.value("initial_contraction")
    if radius is None or ratio is None:
        return
    middle = ratio * muscle.initial_length
    room = min(middle + muscle.largest_extension, muscle.largest_contraction - middle)
    if room <= 0:
        largest = muscle.largest_contraction / muscle.initial_length
        message = f"got {ratio:.3g}, but a muscle of this braid angle shortens by {largest:.2g} at most"
        bench.problems.add("initial_contraction in the card", message)
        return
    for name in bench.checked("joint angle"):
        values = bench.columns[name]
        at = int(np.nanargmax(np.abs(values)))
        largest = abs(float(values[at]))
        if largest * radius <= room:
            continue
        small = lambda r, most=largest: 0.03 * room <= most * r <= room  # noqa: E731
        bench.add(
            name,
            f"{bench.shown(name, float(values[at]))} in {bench.row(at)} cannot be: expected at most "
            f"{bench.shown(name, room / radius)} to either side, with muscles of "
            f"{muscle.initial_length:.3g} m on a sprocket of {radius:.3g} m",
            bench.units_of_column(name, largest, lambda x: x * radius <= room),
            bench.units_of_quantity("sprocket_radius", small),
            ELSEWHERE,
        )
