"""Whether a recording can be of the machine that its card describes: travel, pressure, force, time.

Each check refuses only what is off by so much that a unit, a sign or a column must be wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.errors import Problems
from jaxmuscle.recordings.bench import Bench
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.muscle_limits import MuscleLimits
from jaxmuscle.recordings.pressures import check_lifting, check_pull, check_regulators
from jaxmuscle.recordings.travel import check_angles, check_contraction, check_rise
from jaxmuscle.recordings.units import Series

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
