"""Plausibility of a recording: whether it can be of the machine that its card describes, and whether its
pressures go with the supply, the load, the force or the commands.

Each check refuses only what is off by so much that a unit, a sign or a column must be wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.errors import Problems
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.card_sections import SUPPLY
from jaxmuscle.recordings.muscle_limits import (
    Bench,
    MuscleLimits,
    check_angles,
    check_contraction,
    check_rise,
)
from jaxmuscle.units import Series

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


STANDARD_GRAVITY = 9.80665
"""[m/s^2]"""
COMMAND = 10.0, 100.0
"""Times that a command may be above the one that opens the valve fully, and below it."""
SLOW, SHORT = 100.0, 3.0
"""Sampling step at most and length at least, in time constants of what drives the machine."""


def check_machine(
    file: object,
    rig: type[AbstractActuator],
    card: Card,
    columns: Mapping[str, Series],
    step: float,
    row: Callable[[int], str] = lambda index: f"sample {index}",
) -> None:
    """Raise `InputError` when the samples cannot be of the machine that the card describes.

    Args:
        file: begins the message.
        rig: class of the machine; its columns are held to what they are declared to be checked for.
        columns: quantity → samples in SI, pressures absolute; NaN where there is no reading.
        step: sampling step [s].
        row: how the user calls the sample at an index.
    """
    bench = Bench(rig, card, columns, step, Problems(file), row)
    muscle = MuscleLimits.of(card)
    _check_clock(bench)
    if bench.checked("regulated pressure"):
        check_regulators(bench)
    if bench.checked("valve command"):
        _check_command(bench)
    if muscle is not None:
        _check_muscle(bench, muscle)
    bench.problems.check()


def _check_muscle(bench: Bench, muscle: MuscleLimits) -> None:
    """What moves goes no further than the muscle of the card, and what pulls is its pressure."""
    if bench.checked("joint angle"):
        check_angles(bench, muscle)
    moved = bench.checked("contraction") or bench.checked("lift")
    if not moved:
        return
    check_contraction(bench, muscle)
    bench.problems.check()
    if not bench.checked("muscle pressure"):
        return
    if bench.checked("contraction") and bench.checked("muscle force"):
        check_pull(bench, muscle)
    if bench.checked("lift"):
        weight = STANDARD_GRAVITY * (bench.value("mass") or 0.0)
        check_lifting(bench, muscle, weight)
        check_rise(bench, muscle, weight)


def _check_command(bench: Bench) -> None:
    """A command is of the size of the one that opens the valve fully."""
    (command,) = bench.checked("valve command")
    full, most = abs(bench.value("full_command") or 0.0), float(np.nanmax(np.abs(bench.columns[command])))
    above, below = COMMAND
    if 0 in (full, most) or full / below < most < above * full:
        return
    alike = lambda x: 0.1 * full < x < 2 * full  # noqa: E731
    bench.add(
        command,
        f"at most {bench.shown(command, most)}, but full_command, at which the valve is open, is "
        f"{bench.shown(command, full)}",
        bench.units_of_column(command, most, alike),
        bench.units_of_quantity("full_command", lambda x: 0.5 * most < x < 10 * most),
    )


def _check_clock(bench: Bench) -> None:
    """The recording is fast and long enough to see what drives the machine."""
    constant, frequency = bench.value("valve_time_constant"), bench.value("regulator_frequency")
    if constant is None and frequency:
        constant = 1 / (2 * np.pi * frequency)
    if not constant:
        return
    length = bench.step * (len(next(iter(bench.columns.values()))) - 1)
    if bench.step < SLOW * constant and length > SHORT * constant:
        return
    samples = length / bench.step
    seen = lambda t: 0.01 * constant < t < 10 * constant and t * samples > SHORT * constant  # noqa: E731
    bench.add(
        "time",
        f"{length:.3g} s in steps of {bench.step:.3g} s, while the drive of this machine has a time constant "
        f"of {constant:.3g} s",
        bench.units_of_column("time", bench.step, seen),
    )
