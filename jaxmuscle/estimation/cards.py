"""A fit as a card, from which the fitted machine can be built again."""

from __future__ import annotations

import math

import numpy as np

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.data import FitData
from jaxmuscle.parameter_names import card_name, of_machine, split_effect
from jaxmuscle.parameters import get, parameters
from jaxmuscle.recordings.card import Card, Estimate, actuator_from_card, can_declare


def number_of(result: FitData, recording: str | int) -> int:
    """The number of a recording by its name or number; `InputError` when there is none."""
    names = list(result.cards)
    if isinstance(recording, str):
        if recording not in names:
            raise InputError(f"the fit has no recording {recording!r}{nearest(recording, names)}")
        return names.index(recording)
    if not -len(names) <= recording < len(names):
        raise InputError(f"the fit has {len(names)} recordings; got number {recording}")
    return recording % len(names)


def fitted_card(result: FitData, recording: str | int) -> Card:
    """The card of a recording with fitted values; a machine built from it equals the fitted one.

    Quantities that were not fitted, but differ from the card, become known ones of the machine's value. A
    card has no place for the offset of a sensor, for an initial state, or for an effect whose class is not
    registered or has arrays: they are told in the description.
    """
    number = number_of(result, recording)
    label, card = list(result.cards.items())[number]
    actuator, declared = result.actuators[number], parameters(actuator_from_card(card))
    values: dict[str, Estimate] = {}
    effects: dict[str, dict[str, Estimate]] = {}
    for name, path in actuator.quantities.items():
        if float(get(actuator, path)) != declared[path].value:
            values[name] = (float(get(actuator, path)), None)
    holds = {name for name, effect in actuator.effects.items() if can_declare(name, effect)}
    told = []
    for path, entry in parameters(actuator).items():
        effect, parameter = split_effect(path)
        if effect is None:
            continue
        if effect not in holds:
            told.append(f"{path} = {np.asarray(entry.value).tolist()} {entry.unit}".rstrip())
        elif path not in declared or declared[path].value != entry.value:
            effects.setdefault(effect, {})[parameter] = (float(entry.value), None)
    for name, fitted in result.parameters.items():
        if fitted.recording not in (None, label):
            continue
        estimate = (fitted.value, fitted.std if 0 < fitted.std < math.inf else None)
        if not of_machine(fitted.path):
            told.append(f"{name} = {fitted.value:g} {fitted.unit}")
            continue
        effect, parameter = split_effect(fitted.path)
        if effect in holds:
            effects.setdefault(effect, {})[parameter] = estimate
        elif effect is None:
            values[_quantity(actuator, fitted.path)] = estimate
    return card.updated(values, effects).telling(told)


def _quantity(actuator: AbstractActuator, path: str) -> str:
    name = card_name(actuator.quantities, path)
    if name in actuator.quantities:
        return name
    raise InputError(f"cards of rig {actuator.rig!r} have no name for {path!r}; use fit.actuator instead")
