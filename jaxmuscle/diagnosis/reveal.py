"""The picture that reveals an effect: what is missing without it, against the variable it depends on."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.candidates import strength_path
from jaxmuscle.diagnosis.rates import MissingRate, missing_rates
from jaxmuscle.diagnosis.result import Reveal
from jaxmuscle.diagnosis.unknown import dependence, explained, variables
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.case import Case
from jaxmuscle.parameters import replace

Series = NDArray[np.float64]


def reveal(
    case: Case,
    model: AbstractActuator,
    effect: type[AbstractEffect] | None,
    missing: Sequence[MissingRate],
) -> Reveal | None:
    """Partial residuals of `effect`: what the final model lacks when only that effect is taken out of it.

    The fitted declared model would show less: its other parameters are bent to make up for what it lacks.
    Without an effect, what the model lacks is shown against the variable on which it depends most; `None`
    if it depends on none, or nothing that is measured moves.

    Args:
        model: the final model.
        missing: its missing rates.
    """
    without = missing_rates(case, replace(model, {strength_path(effect): 0.0})) if effect else missing
    old, new, column = max(
        ((a, b, c) for a, b in zip(without, missing, strict=True) for c in a.values),
        key=lambda entry: _size(entry[0] if effect is None else _difference(*entry), entry[2]),
    )
    named = variables(case)
    if not named:
        return None
    if effect is None:
        alone = dataclasses.replace(old, values={column: old.values[column]})
        found = dependence(alone, named, case).variables
        if not found:
            return None
        variable = found[0]
    else:
        difference = _difference(old, new, column)
        variable = max(named, key=lambda name: explained(difference, named, (name,), case))
    rate = variable in case.actuator.derivatives
    unit = case.actuator.states[variable].unit if rate else case.actuator.column(variable).unit
    return Reveal(
        effect=effect.name if effect else None,
        signal=old.link.signal,
        variable=variable,
        variable_unit=unit,
        unit=old.unit,
        x=named[variable],
        before=old.values[column],
        after=new.values[column],
    )


def _difference(old: MissingRate, new: MissingRate, column: str) -> MissingRate:
    """What the effect adds to a column's rate, with no sample better known than another."""
    spread = np.full_like(new.spread[column], np.median(new.spread[column]))
    return dataclasses.replace(
        old, values={column: old.values[column] - new.values[column]}, spread={column: spread}
    )


def _size(missing: MissingRate, column: str) -> float:
    return float(np.mean((missing.values[column] / np.maximum(missing.spread[column], 1e-300)) ** 2))
