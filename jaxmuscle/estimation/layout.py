"""From what the user asks for to the vector of unknowns; every contradiction is told."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.agreement import agreed_prior, said_of
from jaxmuscle.estimation.asked import Asked, Bounds, read_bounds, read_prior
from jaxmuscle.estimation.beginnings import start_places
from jaxmuscle.estimation.names import columns, fittable, range_of
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.estimation.within import unknown_within
from jaxmuscle.fitting.prior import Prior
from jaxmuscle.parameter_names import START, expanded, of_machine, resolve
from jaxmuscle.parameters import Parameter
from jaxmuscle.recordings.recording import Recording


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
    single = {f"{name}[{label}]" for name in own for label in labels} if many else set()
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
        single: names of what a single recording has of its own, ``mass[lift-2]``; they stay as they are.
    """
    found = {}
    for written, entry in given.items():
        value = read(entry, f"{where}[{written!r}]")
        if written in single:
            found[written] = value
            continue
        # Of an array that is given as a whole, entries that are not free may stay as they are.
        names = [p.name for p in expanded(known, resolve(known, written, where)) if p.name in chosen]
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
        for column in columns(actuator)
    }
