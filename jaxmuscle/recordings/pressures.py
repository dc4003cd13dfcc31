"""Whether the pressures of a recording go with the supply, the load, the force or the commands."""

from __future__ import annotations

import numpy as np

from jaxmuscle.recordings.bench import Bench
from jaxmuscle.recordings.muscle_limits import MuscleLimits
from jaxmuscle.recordings.sections import SUPPLY

FACTOR = 10.0
"""Ratio of two numbers that should be alike from which one of them is in a wrong unit."""
CANNOT_LIFT = 3.0
"""Ratio of a weight to the largest pull beyond which the muscle cannot have lifted it."""
LITTLE_OF_SUPPLY = 50.0
"""Ratio of the supply to the largest measured pressure beyond which these do not belong together."""
LEAST, LARGEST = 1e4, 1e7
"""Gauge pressures between which pneumatic muscles work, at least once in a recording [Pa]."""
FILLED = 5e4
"""Gauge pressure from which a regulator is sure to regulate [Pa]."""
MOVES = 2e3
"""Gauge pressure by which that of a muscle that is filled and emptied changes at least [Pa]."""
ALIKE = 0.8
"""Correlation from which one signal is said to follow another."""


def check_lifting(bench: Bench, muscle: MuscleLimits, weight: float) -> None:
    """A mass that rose was lifted by the measured pressure, which comes from the supply."""
    (pressure,), (rise,) = bench.checked("muscle pressure"), bench.checked("lift")
    supply, most = bench.value(SUPPLY), bench.most(pressure)
    if supply is None:
        return
    per_pascal, supplied = float(muscle.force(0.0, 1.0)), supply - bench.card.ambient_pressure
    pull, rose = per_pascal * most, bench.most(rise) > muscle.offset
    enough = 1.0 if supplied > FACTOR * most else CANNOT_LIFT
    weak = rose and enough * pull < weight
    if not weak and supplied < LITTLE_OF_SUPPLY * most:
        return
    lifts = lambda p: supplied / FACTOR < p < 1.05 * supplied and per_pascal * p > weight  # noqa: E731
    of_supply = lambda p: most < p - bench.card.ambient_pressure < FACTOR * most  # noqa: E731
    message = f"at most {bench.shown(pressure, most)} gauge, of a supply of {bench.shown(pressure, supplied)}"
    likely = [bench.units_of_column(pressure, most, lifts)]
    if weak:
        mass = bench.value("mass") or 0.0
        message += (
            f"; this muscle pulls {max(pull, 0.0):.3g} N at that, and lifted {mass:.4g} kg, {weight:.3g} N"
        )
        light = lambda m: pull / FACTOR**3 < m / mass * weight < pull  # noqa: E731
        wide = lambda r: weight < (r / muscle.initial_radius) ** 2 * pull < FACTOR**3 * weight  # noqa: E731
        likely += [bench.units_of_quantity("mass", light), bench.units_of_quantity("initial_radius", wide)]
    else:
        likely += [bench.units_of_quantity(SUPPLY, of_supply)]
    bench.add(pressure, message, *likely)


def check_pull(bench: Bench, muscle: MuscleLimits) -> None:
    """Where a muscle is filled and emptied, the force follows the pressure about as [T] has it."""
    names = (bench.checked(check) for check in ("muscle pressure", "contraction", "muscle force"))
    (of_pressure,), (of_contraction,), (of_force,) = names
    pressure, most = bench.gauge(of_pressure), bench.most(of_pressure)
    if most > LARGEST:
        usual = bench.units_of_column(of_pressure, most, lambda p: LEAST < p < LARGEST / FACTOR)
        bench.add(of_pressure, f"{bench.shown(of_pressure, most)} gauge is beyond any muscle", usual)
        return
    if most - float(np.nanmin(pressure)) < max(0.5 * most, MOVES):
        return  # A passive muscle may be stretched.
    ideal, force = np.asarray(muscle.force(bench.columns[of_contraction], pressure)), bench.columns[of_force]
    there = np.isfinite(ideal) & np.isfinite(force)
    spread = float(np.std(ideal[there])), float(np.std(force[there]))
    if min(spread) == 0:
        return
    alike, ratio = float(np.corrcoef(ideal[there], force[there])[0, 1]), spread[1] / spread[0]
    if alike < -ALIKE:
        message = (
            "falls where the muscle is filled and shortened as if it pushed; expected tension as positive"
        )
        bench.add(of_force, message, "of the opposite sign")
    elif alike > ALIKE and not 1 / FACTOR < ratio < FACTOR:
        near = lambda x: 1 / 3 < ratio * x < 3  # noqa: E731
        bench.add(
            of_force,
            f"changes {ratio:.3g} times as much as that of an ideal muscle at the pressures of "
            f"{bench.column(of_pressure)}, which go up to {bench.shown(of_pressure, most)} gauge",
            bench.units_of_column(of_force, 1.0, near),
            bench.units_of_column(of_pressure, most, lambda p: near(most / p) and LEAST < p < LARGEST),
            bench.units_of_quantity("initial_radius", lambda r: near((muscle.initial_radius / r) ** 2)),
        )


def check_regulators(bench: Bench) -> None:
    """Each pressure is about what its regulator is asked for, and some pressure moves a muscle."""
    pairs = list(zip(bench.rig.commands, bench.checked("regulated pressure"), strict=False))
    asked, largest = (max((bench.most(pair[i]), pair[i]) for pair in pairs) for i in (0, 1))
    if not LEAST <= max(asked[0], largest[0]) <= LARGEST:
        most, name = largest
        usual = bench.units_of_column(name, most, lambda p: FILLED <= p <= LARGEST / FACTOR)
        message = f"at most {bench.shown(name, most)} gauge, at which no pneumatic muscle works"
        bench.add(name, message, usual and f"{usual}, and in the other pressures")
        return
    for command, pressure in pairs:
        wanted, found = bench.most(command), bench.most(pressure)
        if max(wanted, found) < FILLED or min(wanted, found) * FACTOR > max(wanted, found):
            continue
        low, high = sorted(((wanted, command), (found, pressure)))
        (value, wrong), (right, other) = (low, high) if low[0] < LEAST else (high, low)
        bench.add(
            wrong,
            f"at most {bench.shown(wrong, value)} gauge, where {bench.column(other)} has "
            f"{bench.shown(wrong, right)}: a regulator makes them alike",
            bench.units_of_column(wrong, value, lambda p, right=right: 1 / 3 < p / right < 3),
        )
