"""What several cards say of one thing: the conditions of each recording, and priors that have to agree."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.fitting.prior import Prior
from jaxmuscle.parameters import Parameter, replace
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording

APART = 3.0
"""Distance of two priors, in standard deviations of their difference, beyond which they contradict."""


def said_of(card: Card, place: Parameter) -> Prior | float | None:
    """What a card says of a parameter: a prior, a known value, or nothing."""
    quantity = card.entries.get(place.name)
    if quantity is None:
        return None
    return quantity.value if quantity.std is None else Prior(quantity.value, quantity.std)


def agreed_prior(name: str, cards: Sequence[tuple[str, Prior | float | None]]) -> Prior | None:
    """One prior from those on the cards of several recordings.

    They are taken as one piece of knowledge, told several times: means weighted by 1/std², the smallest
    standard deviation.

    Args:
        cards: name of a recording, what its card says.

    Raises:
        InputError: two of them are more than three standard deviations apart.
    """
    priors = [(label, entry) for label, entry in cards if isinstance(entry, Prior)]
    for one, first in priors:
        for other, second in priors:
            if abs(first.mean - second.mean) > APART * math.hypot(first.std, second.std):
                raise InputError(
                    f"contradictory priors of {name!r}: {first.mean:g} ± {first.std:g} on the card of {one}, "
                    f"{second.mean:g} ± {second.std:g} on that of {other}. Does each recording have its own? "
                    f"Then per_recording=[{name!r}]; else say which: priors={{{name!r}: (mean, std)}}"
                )
    if not priors:
        return None
    weights = [prior.std**-2 for _, prior in priors]
    mean = sum(w * prior.mean for w, (_, prior) in zip(weights, priors, strict=True)) / sum(weights)
    return Prior(mean, min(prior.std for _, prior in priors))


def conditions(
    actuator: AbstractActuator, recordings: Sequence[Recording], free: set[str]
) -> list[AbstractActuator]:
    """The machine in each recording: quantities on which the cards differ are each recording's own.

    What all cards say alike, and everything for a single recording, is as it is in `actuator`.

    Args:
        free: paths that the fit moves; they are left as they are.
    """
    varied: dict[str, list[float]] = {}
    for name, path in actuator.quantities.items():
        entries = [recording.card.quantities.get(name) for recording in recordings]
        values = [entry.value for entry in entries if entry is not None]
        if path not in free and len(values) == len(recordings) and len(set(values)) > 1:
            varied[path] = values
    return [
        replace(actuator, {path: values[i] for path, values in varied.items()})
        for i in range(len(recordings))
    ]


def check_same_rig(actuator: AbstractActuator, recordings: Sequence[Recording]) -> None:
    """Raise `InputError` unless there is a recording and all are of the actuator's rig."""
    if not recordings:
        raise InputError("expected at least one recording to fit; got none")
    for recording in recordings:
        if recording.card.rig != actuator.rig:
            raise InputError(
                f"recording {recording.name!r} is of a rig {recording.card.rig!r}, "
                f"the actuator of a rig {actuator.rig!r}; fit recordings of one rig at a time"
            )


def labels(recordings: Sequence[Recording]) -> list[str]:
    """A name for each recording, no two alike: its own, numbered from the second of the same name on.

    A number that makes the name of another recording is passed over: ``a-2``, ``a``, ``a`` are ``a-2``,
    ``a``, ``a-3``.
    """
    own = {recording.name for recording in recordings}
    names: list[str] = []
    for recording in recordings:
        name = recording.name
        if name in names:
            numbered = (f"{name}-{count}" for count in itertools.count(2))
            name = next(each for each in numbered if each not in own and each not in names)
        names.append(name)
    return names
