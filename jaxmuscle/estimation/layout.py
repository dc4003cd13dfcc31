"""From what the user asks for to the vector of unknowns; every contradiction is told."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.agreement import agreed_prior, card_entry
from jaxmuscle.estimation.beginnings import start_places
from jaxmuscle.estimation.names import START, Place, columns, expanded, places, resolve
from jaxmuscle.estimation.unknowns import HALF, Unknown, Unknowns
from jaxmuscle.fitting.free import Prior
from jaxmuscle.recordings.recording import Recording

PriorLike = Prior | tuple[float, float] | None
Bounds = tuple[float | None, float | None]


@dataclasses.dataclass(frozen=True)
class Asked:
    """What the user asks for, names as they were written; see :func:`jaxmuscle.fit`."""

    free: Sequence[str] | None = None
    shared: Sequence[str] = ()
    per_recording: Sequence[str] = ()
    priors: Mapping[str, PriorLike] = dataclasses.field(default_factory=dict)
    bounds: Mapping[str, Bounds] = dataclasses.field(default_factory=dict)
    profiles: Sequence[str] = ()
    continuation: tuple[float, ...] = ()

    @property
    def initial_states(self) -> bool:
        """Whether any of the names is that of an initial state."""
        names = (*(self.free or ()), *self.shared, *self.per_recording, *self.priors, *self.bounds)
        return any(name.startswith(START) for name in (*names, *self.profiles))


def known_places(
    actuator: AbstractActuator, recordings: Sequence[Recording], asked: Asked
) -> list[dict[str, Place]]:
    """For each recording, everything that can be fitted; initial states only if one is asked for."""
    found = places(actuator, _ranges(actuator, recordings))
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
    priors = _named(known, chosen, asked.priors, "priors", _prior)
    bounds = _named(known, chosen, asked.bounds, "bounds", _bounds)
    entries = []
    for name, place in chosen.items():
        groups = [(i,) for i in range(len(recordings))] if name in own else [tuple(range(len(recordings)))]
        for group in groups:
            cards = [(labels[i], card_entry(recordings[i].card, place)) for i in group]
            prior = priors[name] if name in priors else agreed_prior(name, cards)
            label = f"{name}[{labels[group[0]]}]" if name in own and len(recordings) > 1 else name
            start = _start(by_recording[group[0]][name], cards) if name in own else place.value
            if place.path.startswith(START):
                start = _beginning(start, prior, bounds.get(name, (None, None)))
            entries.append(_unknown(label, place, group, start, prior, bounds.get(name, (None, None))))
    return Unknowns(entries)


def _start(place: Place, cards: Sequence[tuple[str, Prior | float | None]]) -> float:
    """A recording's own parameter starts at what its card says of it."""
    entry = cards[0][1]
    return place.value if entry is None else entry.mean if isinstance(entry, Prior) else entry


def _beginning(start: float, prior: Prior | None, bounds: Bounds) -> float:
    """An initial state begins at its prior's mean, else as measured or at rest, in any case within bounds."""
    lower, upper = bounds
    return float(np.clip(start if prior is None else prior.mean, lower, upper))


def _unknown(
    name: str, place: Place, recordings: tuple[int, ...], start: float, prior: Prior | None, bounds: Bounds
) -> Unknown:
    floor = 0.0 if place.positive or place.nonnegative else -math.inf
    lower = floor if bounds[0] is None else max(bounds[0], floor)
    upper = math.inf if bounds[1] is None else bounds[1]
    within = f"{lower:g} to {upper:g} {place.unit}".rstrip()
    if not lower < upper:
        raise InputError(f"bounds of {name}: expected a lower one below the upper one; got {within}")
    if not lower <= start <= upper or (place.positive and start <= 0):
        raise InputError(
            f"bounds of {name}: its start, {start:g}, is not within {within}; "
            f"widen the bounds, or start elsewhere: jaxmuscle.replace(actuator, {{{place.path!r}: …}})"
        )
    if prior is not None:
        if not (math.isfinite(prior.mean) and 0 < prior.std < math.inf):
            raise InputError(f"prior of {name}: expected (mean, std) with a std above zero; got {prior}")
        if not lower <= prior.mean <= upper or (place.positive and prior.mean <= 0):
            raise InputError(
                f"prior of {name}: its mean, {prior.mean:g}, contradicts the bounds {within}; "
                f"change one of them"
            )
    scale = prior.std if prior else HALF * abs(start) or place.typical or 1.0
    return Unknown(name, place, recordings, start, lower, upper, scale, prior)


def _declared(known: Mapping[str, Place], recordings: Sequence[Recording]) -> dict[str, Place]:
    """What the cards call uncertain, declared effects included."""
    names: dict[str, None] = {}
    for recording in recordings:
        names |= dict.fromkeys(recording.card.uncertain)
        for effect, entries in recording.card.effects.items():
            names |= {f"effects.{effect}.{n}": None for n, q in entries.items() if q.std is not None}
    return _resolved(known, names, "the cards")


def _resolved(known: Mapping[str, Place], names: Iterable[str], where: str) -> dict[str, Place]:
    if isinstance(names, str):
        raise InputError(f"{where}: expected a list of names; got the text {names!r}")
    found = [place for name in names for place in expanded(known, resolve(known, name, where))]
    return {place.name: place for place in found}


def _named(known, chosen, given, where, read) -> dict:
    """Entries of `given` by the names of their places, each read; they must be free, and given once."""
    found = {}
    for written, entry in given.items():
        value = read(entry, f"{where}[{written!r}]")
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


def _prior(entry: PriorLike, where: str) -> Prior | None:
    if entry is None or isinstance(entry, Prior):
        return entry
    mean, std = _pair(entry, where, "(mean, std)")
    if mean is None or std is None:
        raise InputError(f"{where}: expected (mean, std), or None for no prior; got {entry!r}")
    return Prior(mean, std)


def _bounds(entry: Bounds, where: str) -> Bounds:
    return _pair(entry, where, "(lower, upper), None for none")


def _pair(entry: object, where: str, wanted: str) -> tuple[float | None, float | None]:
    if isinstance(entry, Sequence) and not isinstance(entry, str) and len(entry) == 2:
        numbers = [x is None or (isinstance(x, int | float | np.number) and not math.isnan(x)) for x in entry]
        if all(numbers):
            low, high = (None if x is None else float(x) for x in entry)
            return low, high
    raise InputError(f"{where}: expected {wanted} in SI; got {entry!r}")


def _ranges(actuator: AbstractActuator, recordings: Sequence[Recording]) -> dict[str, float]:
    return {
        column: max(float(np.nanmax(r.columns[column]) - np.nanmin(r.columns[column])) for r in recordings)
        for column in columns(actuator)
    }
