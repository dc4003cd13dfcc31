"""Layout of the parameter vector: shared by all recordings or one for each, with priors that have to
agree.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.fittable_parameters import fittable, range_of, start_places
from jaxmuscle.estimation.free_parameters import HALF, Prior, Unknown, Unknowns
from jaxmuscle.estimation.request import Asked, Bounds, read_bounds, read_prior
from jaxmuscle.parameter_names import START, of_machine, resolve, spelled
from jaxmuscle.parameters import Parameter, expanded, replace
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.joining import distinct
from jaxmuscle.recordings.recording import Recording


def unknown_within(
    name: str,
    place: Parameter,
    recordings: tuple[int, ...],
    start: float,
    prior: Prior | None,
    bounds: Bounds,
    owner: str = "actuator",
) -> Unknown:
    """An unknown that starts within its bounds.

    Args:
        owner: what has the parameter, for the advice in a message.

    Raises:
        InputError: bounds in the wrong order, a start outside, a prior that is none or contradicts them.
    """
    floor = 0.0 if place.positive or place.nonnegative else -math.inf
    lower = floor if bounds[0] is None else max(bounds[0], floor)
    upper = math.inf if bounds[1] is None else bounds[1]
    within = f"{lower:g} to {upper:g} {place.unit}".rstrip()
    if not lower < upper:
        raise InputError(f"bounds of {name}: expected a lower one below the upper one; got {within}")
    if not lower <= start <= upper or (place.positive and start <= 0):
        raise InputError(
            f"bounds of {name}: its start, {start:g}, is not within {within}; "
            f"widen the bounds, or start elsewhere: jaxmuscle.replace({owner}, {{{place.path!r}: …}})"
        )
    if prior is not None:
        if not (math.isfinite(prior.mean) and 0 < prior.std < math.inf):
            raise InputError(f"prior of {name}: expected (mean, std) with a std above zero; got {prior}")
        if not lower <= prior.mean <= upper or (place.positive and prior.mean <= 0):
            raise InputError(
                f"prior of {name}: its mean, {prior.mean:g}, contradicts the bounds {within}; "
                f"change one of them"
            )
    # The first reading of a state may be next to zero, and says nothing of how far the state may be from it.
    natural = HALF * abs(start) if of_machine(place.path) else place.typical or HALF * abs(start)
    scale = prior.std if prior else natural or place.typical or 1.0
    return Unknown(name, place, recordings, start, lower, upper, scale, prior)


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
    """A name for each recording, no two alike: its own, numbered from the second of the same name on."""
    return distinct([recording.name for recording in recordings])


def known_places(
    actuator: AbstractActuator, recordings: Sequence[Recording], asked: Asked
) -> list[dict[str, Parameter]]:
    """For each recording, everything that can be fitted; initial states only if one is asked for."""
    found = fittable(actuator, _ranges(actuator, recordings))
    if not asked.initial_states:
        return [found] * len(recordings)
    return [{**found, **start_places(actuator, recording)} for recording in recordings]


def layout(
    actuator: AbstractActuator, recordings: Sequence[Recording], labels: Sequence[str], asked: Asked
) -> Unknowns:
    """The unknowns of a fit.

    Raises:
        InputError: an unknown parameter, nothing free, a bound that excludes the start, priors that
            contradict each other or a bound.
    """
    by_recording = known_places(actuator, recordings, asked)
    known = by_recording[0]
    own = _resolved(known, asked.per_recording, "per_recording")
    shared = _resolved(known, asked.shared, "shared")
    if both := [name for name in own if name in shared]:
        raise InputError(f"{both[0]!r} is both in shared and in per_recording; keep it in one of them")
    declared = _declared(known, recordings) if asked.free is None else _resolved(known, asked.free, "free")
    chosen = {**declared, **shared, **own}
    if not chosen:
        raise InputError(
            "nothing is free: the cards call no quantity uncertain and free= names none; "
            "give a quantity a std on its card, or name it: free=['end_factor']"
        )
    if nothing := [place.name for place in chosen.values() if math.isnan(place.value)]:
        raise InputError(
            f"free: {nothing[0]!r} is not a number (NaN) in the machine; give it a value to start at"
        )
    # Recordings begin each in its own way: an initial state is shared only where that is asked for.
    own |= {n: p for n, p in chosen.items() if p.path.startswith(START) and n not in shared}
    many = len(recordings) > 1
    single: dict[str, str] = {}
    for name, label in itertools.product(own if many else (), labels):
        single |= spelled({name: own[name].path}, f"[{label}]")
    priors = _named(known, chosen, single, asked.priors, "priors", read_prior)
    bounds = _named(known, chosen, single, asked.bounds, "bounds", read_bounds)
    entries = []
    for name, place in chosen.items():
        groups = [(i,) for i in range(len(recordings))] if name in own else [tuple(range(len(recordings)))]
        for group in groups:
            cards = [(labels[i], said_of(recordings[i].card, place)) for i in group]
            label = f"{name}[{labels[group[0]]}]" if name in own and many else name
            given = next((n for n in (label, name) if n in priors), None)
            prior = agreed_prior(name, cards) if given is None else priors[given]
            within = bounds.get(label, bounds.get(name, (None, None)))
            start = _start(by_recording[group[0]][name], cards) if name in own else place.value
            if not of_machine(place.path):
                start = _beginning(start, prior, within)
            entries.append(unknown_within(label, place, group, start, prior, within))
    return Unknowns(entries)


def _start(place: Parameter, cards: Sequence[tuple[str, Prior | float | None]]) -> float:
    """A recording's own parameter starts at what its card says of it."""
    entry = cards[0][1]
    return place.value if entry is None else entry.mean if isinstance(entry, Prior) else entry


def _beginning(start: float, prior: Prior | None, bounds: Bounds) -> float:
    """What no machine says, an offset or an initial state, begins at its prior's mean, else at zero, as
    measured or at rest, in any case within bounds.
    """
    lower, upper = bounds
    return float(np.clip(start if prior is None else prior.mean, lower, upper))


def _declared(known: Mapping[str, Parameter], recordings: Sequence[Recording]) -> dict[str, Parameter]:
    """What the cards call uncertain, declared effects included."""
    names: dict[str, None] = {}
    for recording in recordings:
        names |= {name: None for name, entry in recording.card.entries.items() if entry.std is not None}
    return _resolved(known, names, "the cards")


def _resolved(known: Mapping[str, Parameter], names: Iterable[str], where: str) -> dict[str, Parameter]:
    if isinstance(names, str):
        raise InputError(f"{where}: expected a list of names; got the text {names!r}")
    found = [place for name in names for place in expanded(known, resolve(known, name, where))]
    return {place.name: place for place in found}


def _named(known, chosen, single, given, where, read) -> dict:
    """Entries of `given` by the names of their places, each read; they must be free, and given once.

    Args:
        single: spelling → name of what a single recording has of its own, ``mass[lift-2]``.
    """
    found = {}
    for written, entry in given.items():
        value = read(entry, f"{where}[{written!r}]")
        place = resolve({**known, **single}, written, where)
        # Of an array that is given as a whole, entries that are not free may stay as they are.
        own = [place] if isinstance(place, str) else [p.name for p in expanded(known, place)]
        names = [name for name in own if name in chosen or name in single]
        if not names:
            raise InputError(f"{where}: {written!r} is not free; add it to free= or leave it out of {where}=")
        for name in names:
            if name in found and found[name] != value:
                raise InputError(
                    f"{where}: {name!r} is given twice, as {found[name]} and as {value}; keep one"
                )
            found[name] = value
    return found


def _ranges(actuator: AbstractActuator, recordings: Sequence[Recording]) -> dict[str, float]:
    return {
        column: max(range_of(recording.columns[column]) for recording in recordings)
        for column in measured_columns(actuator)
    }
