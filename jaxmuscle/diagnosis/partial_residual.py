"""Partial residuals of an effect: what the final model lacks without it, against what reveals it best.

An effect says by its `view` what that is: a measured variable (friction against the velocity), a variable
that rises and falls (the loop of a hysteresis), the command (a dead band), the time since the machine was
last moved (creep, on a logarithmic scale), the time of the recording (a drift).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought
from jaxmuscle.diagnosis.candidates import without as without_it
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.dependence import Series, explained, variables
from jaxmuscle.diagnosis.diagnosis_data import RIPPLE, TONE, Pattern, Reveal, Unexplained
from jaxmuscle.diagnosis.discrepancy import MissingRate, missing_rates
from jaxmuscle.effects.base import COMMANDED, LOG_TIME, LOOP, TIME, VARIABLE
from jaxmuscle.estimation.case import Case
from jaxmuscle.parameters import replace
from jaxmuscle.recordings.schema import imposed_columns
from jaxmuscle.signals import COMMAND, TIP_POSITION

HELD = 1e-3
"""Part of its range by which a column may move from sample to sample and counts as held."""
SLOW = 0.02
"""Part of the greatest velocity up to which a machine counts as at rest."""
SHORTEST_HOLD = 0.5
"""Seconds from which a hold shows something that goes on."""
FEWEST_HOLDS = 2
ENDS = 0.05
"""Part of a hold whose median is its beginning, or its end."""


def reveal(
    case: Case,
    model: AbstractActuator,
    effect: Sought | None,
    missing: Sequence[MissingRate],
    left: Sequence[Unexplained] = (),
) -> Reveal | None:
    """Partial residuals of `effect`: what the final model lacks when only that is taken out of it.

    The fitted declared model would show less: its other parameters are bent to make up for what it lacks.
    Without an effect, what the model leaves unexplained is shown by its pattern, or against the variable on
    which it depends most; `None` if nothing is left, or it depends on none, or nothing measured moves.

    Args:
        model: the final model.
        missing: its missing rates.
        left: what it leaves unexplained.
    """
    bare = missing_rates(case, replace(model, without_it(effect))) if effect else missing
    of_signal = {each.signal: each for each in left}
    old, new, column = max(
        (
            (a, b, c)
            for a, b in zip(bare, missing, strict=True)
            for c in a.values
            if effect is not None or not left or a.link.signal in of_signal
        ),
        key=lambda entry: _size(entry[0] if effect is None else _difference(*entry), entry[2]),
    )
    name = None if effect is None else effect.name
    shown = Reveal(name, old.link.signal, "", "", old.unit, old.values[column] * np.nan,
                   old.values[column], new.values[column])  # fmt: skip
    unexplained = of_signal.get(old.link.signal)
    if effect is None and unexplained is not None and unexplained.pattern is not None:
        return _by_pattern(case, shown, unexplained.pattern)
    view = VARIABLE if effect is None or isinstance(effect, CardConstant) else effect.view
    if view == TIME:
        return dataclasses.replace(
            shown, variable="time", variable_unit="s", x=case.recording.time, view=TIME
        )
    if view == LOG_TIME and (since := _since_moved(case, shown)) is not None:
        return since
    if commands := _commands(case, effect, view):
        column = max(commands, key=lambda each: np.ptp(case.filled.columns[each]))
        return _against(case, shown, column, case.filled.columns[column], LOOP if view == LOOP else COMMANDED)
    named = variables(case)
    if view == LOOP:
        named = {each: x for each, x in named.items() if each not in case.actuator.derivatives} or named
    if not named:
        return None
    if effect is None:
        if unexplained is None or not unexplained.depends_on:
            return None
        variable = unexplained.depends_on[0]
    else:
        difference = _difference(old, new, column)
        variable = max(named, key=lambda each: explained(difference, named, (each,), case))
    return _against(case, shown, variable, named[variable], LOOP if view == LOOP else VARIABLE)


def _by_pattern(case: Case, shown: Reveal, pattern: Pattern) -> Reveal:
    """A tone within one of its periods, a ripple over its variable, all else in time."""
    if pattern.kind == RIPPLE:
        return _against(case, shown, pattern.variable, case.filled.columns[pattern.variable], VARIABLE)
    time = case.recording.time
    if pattern.kind == TONE and pattern.at is not None:
        within = np.mod(time, 1 / pattern.at)
        return dataclasses.replace(shown, variable="time within a period", variable_unit="s", x=within)
    return dataclasses.replace(shown, variable="time", variable_unit="s", x=time, view=TIME)


def _against(case: Case, shown: Reveal, variable: str, x: Series, view: str) -> Reveal:
    rate = variable in case.actuator.derivatives
    unit = case.actuator.states[variable].unit if rate else case.actuator.column(variable).unit
    return dataclasses.replace(shown, variable=variable, variable_unit=unit, x=x, view=view)


def _commands(case: Case, effect: Sought | None, view: str) -> tuple[str, ...]:
    """The commands, where an effect is best seen against them and they move."""
    if effect is None or isinstance(effect, CardConstant):
        return ()
    wanted = view == COMMANDED or (view == LOOP and effect.slot in (COMMAND, TIP_POSITION))
    moving = tuple(name for name in case.actuator.commands if np.ptp(case.filled.columns[name]) > 0)
    return moving if wanted else ()


def holds(case: Case) -> list[NDArray[np.int64]]:
    """Rows of every stretch in which what moves the machine is held and the machine has come to rest."""
    driving = np.stack([case.filled.columns[name] for name in imposed_columns(type(case.actuator))])
    still = np.ones(driving.shape[1], dtype=bool)
    still[1:] = (np.abs(np.diff(driving)) <= HELD * np.ptp(driving, axis=1)[:, None]).all(axis=0)
    for rate in case.actuator.derivatives:
        speed = np.abs(np.asarray(case.observed.track.measured[rate]).reshape(len(still), -1))
        still &= (speed <= SLOW * speed.max(axis=0)).all(axis=1)
    still[list(case.recording.breaks)] = False
    parts = np.split(np.arange(len(still)), np.flatnonzero(~still))
    least = SHORTEST_HOLD / case.recording.step
    # Each part but the first begins with the row at which the machine was moved.
    return [rows for part in parts if len(rows := part[still[part]]) >= least]


def _since_moved(case: Case, shown: Reveal) -> Reveal | None:
    """What is missing since the machine was last moved, all in one direction; `None` without such holds.

    Each hold begins at zero, and is turned over where the effect makes the missing rate fall.
    """
    found = holds(case)
    if len(found) < FEWEST_HOLDS:
        return None
    x, before, after = (np.full(len(case.recording), np.nan) for _ in range(3))
    for rows in found:
        edge = max(1, round(ENDS * len(rows)))
        first, last = rows[:edge], rows[-edge:]
        own = shown.before - shown.after
        sign = 1.0 if np.median(own[last]) >= np.median(own[first]) else -1.0
        x[rows] = case.recording.step * (1 + np.arange(len(rows)))
        for to, values in ((before, shown.before), (after, shown.after)):
            to[rows] = sign * (values[rows] - np.median(values[first]))
    return dataclasses.replace(
        shown, variable="time since the last move", variable_unit="s", x=x, before=before, after=after,
        view=LOG_TIME,
    )  # fmt: skip


def _difference(old: MissingRate, new: MissingRate, column: str) -> MissingRate:
    """What the effect adds to a column's rate, with no sample better known than another."""
    spread = np.full_like(new.spread[column], np.median(new.spread[column]))
    return dataclasses.replace(
        old, values={column: old.values[column] - new.values[column]}, spread={column: spread}
    )


def _size(missing: MissingRate, column: str) -> float:
    return float(np.mean((missing.values[column] / np.maximum(missing.spread[column], 1e-300)) ** 2))
