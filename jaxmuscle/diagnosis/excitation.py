"""Excitation of a recording: the measured signals that move, and the effects that can show in it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import carries_state, loaded, paths_of, shapes, strength_path
from jaxmuscle.diagnosis.discrepancy import rates_and_readings
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.recordings.smoothing import noise_level
from jaxmuscle.simulation import Track

Series = NDArray[np.float64]
Rows = NDArray[np.int64]

MIN_EXCITATION_NOISE_RATIO = 1.5
"""Standard deviation of a signal in units of its sensor's noise below which it counts as constant."""
CONSTANT = 1e-6
"""Range of an effect's addition, relative to its size, up to which it is a constant."""
ROUNDING = 1e-12
"""Change of a prediction relative to its size that is rounding."""


def training_segments(case: Case) -> list[Rows]:
    """Rows that are fitted, run by run: between breaks of the recording and without what is held out."""
    windows, used = case.windows, np.zeros(len(case.recording), dtype=bool)
    for number in np.flatnonzero(~windows.held_out):
        used[windows.rows[number] + np.flatnonzero(windows.mask[number])] = True
    rows = np.flatnonzero(used)
    breaks = np.searchsorted(rows, case.recording.breaks)
    jumps = np.flatnonzero(np.diff(rows) > 1) + 1
    return [part for part in np.split(rows, np.unique([*breaks, *jumps]).astype(int)) if part.size]


def is_still(values: Series, noise: float) -> bool:
    """Whether a signal does not move beyond the noise of its sensor."""
    return bool(np.ptp(values) == 0 or np.std(values) <= MIN_EXCITATION_NOISE_RATIO * noise)


def moving_columns(case: Case) -> set[str]:
    """Columns that move over the training rows as a whole: within a segment, or from one to the next."""
    rows = np.concatenate(training_segments(case))
    return {
        name for name, values in case.filled.columns.items() if not is_still(values[rows], _noise(case, name))
    }


def columns_moving_within_a_segment(case: Case) -> set[str]:
    """Columns that move within at least one run: those that have a rate."""
    segments = training_segments(case)
    return {
        name
        for name, values in case.filled.columns.items()
        if not all(is_still(values[rows], _noise(case, name)) for rows in segments)
    }


def excited(
    case: Case, actuator: AbstractActuator, effects: Sequence[type[AbstractEffect]]
) -> list[type[AbstractEffect]]:
    """Those of `effects` that can show in the training rows: what they add there is not constant.

    A friction needs a velocity, a hysteresis or a creep a change of length: in an isometric test, the
    standard test of a muscle, they add nothing, or a constant, at any strength. Signals within the noise of
    their sensors are taken as constant, segment by segment; then the rates and readings of the model with
    the effect and without it are compared at every row. What an effect with a state of its own adds has to
    vary within a segment, what another adds may also vary between segments. Nothing is computed if every
    measured signal moves.

    Args:
        actuator: the model without the effects.
    """
    segments = training_segments(case)
    track, changed = _with_still_signals_constant(case, segments)
    if not changed:
        return list(effects)
    stateless = loaded(actuator, [effect for effect in effects if not carries_state(effect)])
    plain = _predictions(case, stateless, track)
    kept = []
    for effect in effects:
        model = (
            stateless
            if effect.name in stateless.effects
            else stateless.with_effects(**{effect.name: effect()})
        )
        with_it = _predictions(case, replace(model, _typical_values(model, effect)), track)
        groups = segments if carries_state(effect) else [np.concatenate(segments)]
        if any(_varies(with_it[name], plain[name], groups) for name in plain):
            kept.append(effect)
    return kept


def _noise(case: Case, column: str) -> float:
    return case.recording.card.noise.get(column) or noise_level(case.filled.columns[column])


def _with_still_signals_constant(case: Case, segments: Iterable[Rows]) -> tuple[Track, bool]:
    """The measured track with means, and no rates, where columns are still; whether any column is."""
    actuator, columns = case.actuator, case.filled.columns
    values = {name: np.array(array) for name, array in case.observed.track.measured.items()}
    rates = {base: rate for rate, base in actuator.derivatives.items()}
    changed = False
    for state, names in actuator.measured.items():
        for place, name in enumerate(names):
            for rows in segments:
                if not is_still(columns[name][rows], _noise(case, name)):
                    continue
                changed = True
                entry = rows if len(names) == 1 else (rows, place)
                values[state][entry] = values[state][entry].mean()
                if state in rates:
                    values[rates[state]][entry] = 0.0
    still = any(np.ptp(columns[name][rows]) == 0 for name in actuator.commands for rows in segments)
    track = case.observed.track
    arrays = {name: jnp.asarray(array) for name, array in values.items()}
    return eqx.tree_at(lambda t: t.measured, track, arrays), changed or still


def _predictions(case: Case, model: AbstractActuator, track: Track) -> dict[str, Series]:
    rates, readings = rates_and_readings(model, track, case.observed.samples, case.problem.substeps)
    both = {f"rate of {name}": array for name, array in rates.items()} | readings
    return {name: np.asarray(array).reshape(case.observed.samples, -1) for name, array in both.items()}


def _typical_values(model: AbstractActuator, effect: type[AbstractEffect]) -> dict[str, float]:
    """All parameters of an effect at values at which it acts, its strength included."""
    own = paths_of(model, effect.name)
    typical = {p: e.typical for p, e in parameters(model).items() if p in own and e.typical is not None}
    return {strength_path(effect): 1.0, **typical, **next(shapes(effect), {})}


def _varies(with_it: Series, without: Series, groups: Sequence[Rows]) -> bool:
    """Whether what an effect adds to a prediction is anything but a constant in one of the groups of rows."""
    added = with_it - without
    if not np.isfinite(added).all():
        return True
    size, rounding = np.abs(added).max(), ROUNDING * np.abs(without).max()
    return any(np.ptp(added[rows], axis=0).max() > CONSTANT * size + rounding for rows in groups)
