"""Preparation of a fit: from its arguments and recordings to the objective and the starts; the arguments as
plain data, with which the same can be asked for again.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.readings import measured_columns
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import request
from jaxmuscle.estimation.dataset import aligned, station
from jaxmuscle.estimation.free_parameters import Prior, Unknowns
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.missing_data import Mask, noise_of_readings
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.parameter_layout import check_same_rig, conditions, known_places, labels, layout
from jaxmuscle.estimation.request import Asked, PriorLike
from jaxmuscle.estimation.starting_points import given_starts, spread_starts
from jaxmuscle.parameter_names import resolve
from jaxmuscle.parameters import expanded
from jaxmuscle.recordings.recording import Recording

ESTIMATED, DISCREPANCY = "estimated", "discrepancy"
Masks = Mask | Sequence[Mask | None] | None
NoiseLike = str | Mapping[str, float] | None


def asked_for(
    free: Any,
    shared: Any,
    per_recording: Any,
    priors: Any,
    bounds: Any,
    profiles: Any = (),
    continuation: Any = (),
) -> Asked:
    """What is asked for, each argument of the right kind.

    Raises:
        InputError: one is not.
    """
    return Asked(
        None if free is None else request.names(free, "free"),
        request.names(shared, "shared"),
        request.names(per_recording, "per_recording"),
        request.by_name(priors, "priors"),
        request.by_name(bounds, "bounds"),
        request.names(profiles, "profiles"),
        _widths(continuation),
    )


def prepared(
    actuator: AbstractActuator,
    recordings: Sequence[Recording],
    asked: Asked,
    masks: Masks,
    noise: NoiseLike,
    rule: Loss,
) -> Objective:
    """The cost of what is asked for on the recordings; arguments as of :func:`jaxmuscle.fit`."""
    check_same_rig(actuator, recordings)
    names = labels(recordings)
    unknowns = layout(actuator, recordings, names, asked)
    profiled(actuator, recordings, asked, {entry.place.name for entry in unknowns.entries})
    named = isinstance(noise, str) and noise in (ESTIMATED, DISCREPANCY)
    if not (noise is None or isinstance(noise, Mapping) or named):
        raise InputError(
            f"noise: expected {ESTIMATED!r}, {DISCREPANCY!r} or a mapping of columns to values; got {noise!r}"
        )
    levels = _checked(actuator, noise) if isinstance(noise, Mapping) else {}
    machines = conditions(actuator, recordings, {e.place.path for e in unknowns.entries})
    stations = [
        station(machine, recording, name, mask, noise_of_readings(machine, recording, mask) | levels)
        for machine, recording, name, mask in zip(
            machines, recordings, names, _masks(masks, recordings), strict=True
        )
    ]
    return Objective(aligned(stations), unknowns, rule)


def profiled(
    actuator: AbstractActuator, recordings: Sequence[Recording], asked: Asked, free: Container[str]
) -> list[str]:
    """The names of all places whose profile is asked for.

    Args:
        free: names of the places that the fit moves.

    Raises:
        InputError: one of them is unknown, or not free.
    """
    known, found = known_places(actuator, recordings, asked)[0], []
    for name in asked.profiles:
        # Of an array that is given as a whole, entries that are not free have none.
        own = [p.name for p in expanded(known, resolve(known, name, "profiles")) if p.name in free]
        if not own:
            raise InputError(f"profiles: {name!r} is not free; add it to free= or leave it out of profiles=")
        found += own
    return found


def _widths(continuation: Any) -> tuple[float, ...]:
    """The factors of a continuation: above 1 and falling."""
    found = request.factors(continuation, "continuation")
    if any(not a > b for a, b in itertools.pairwise((*found, 1.0))):
        raise InputError(
            f"continuation: expected factors that fall from wide to narrow, above 1, such as (30, 6); "
            f"got {continuation!r}"
        )
    return found


def begun_at(
    unknowns: Unknowns, starts: int | Sequence[Mapping[str, float]], seed: int
) -> NDArray[np.float64]:
    """Coordinates of the points from which a fit begins."""
    if isinstance(starts, Sequence) and not isinstance(starts, str):
        return given_starts(unknowns, starts)
    if isinstance(starts, Mapping):
        raise InputError(f"starts: expected a list with a mapping for each start; got only {starts!r}")
    return spread_starts(unknowns, request.whole(starts, "starts", 1), seed)


def _checked(actuator: AbstractActuator, noise: Mapping[str, float]) -> dict[str, float]:
    sensors = {column: column for column in measured_columns(actuator)}
    for column, level in noise.items():
        if column not in sensors:
            raise InputError(f"noise: unknown column {column!r}; expected one of {', '.join(sensors)}")
        if not isinstance(level, Real) or not 0 < level < np.inf:
            raise InputError(
                f"noise[{column!r}]: expected a standard deviation above zero (SI); got {level!r}"
            )
    return {column: float(level) for column, level in noise.items()}


def _masks(masks: Masks, recordings: Sequence[Recording]) -> list[Mask | None]:
    """One mask for each recording."""
    if masks is None:
        return [None] * len(recordings)
    if len(recordings) == 1 and not isinstance(masks, list | tuple):
        return [masks]  # pyright: ignore[reportReturnType]
    if not isinstance(masks, list | tuple) or len(masks) != len(recordings):
        got = f"{len(masks)} of them" if isinstance(masks, list | tuple) else type(masks).__name__
        raise InputError(
            f"masks: expected a list with one mask (or None) for each of {len(recordings)} recordings; "
            f"got {got}"
        )
    return list(masks)


def as_settings(asked: Asked, rule: Loss, noise: NoiseLike, masks: Masks) -> dict[str, Any]:
    """What :func:`jaxmuscle.fit` was asked for by these names, where it began and for how long apart."""
    each: Any = masks if isinstance(masks, list | tuple) or masks is None else [masks]
    return {
        "free": None if asked.free is None else list(asked.free),
        "priors": {name: _pair(prior) for name, prior in asked.priors.items()},
        "bounds": {name: tuple(pair) for name, pair in asked.bounds.items()},
        "masks": None if each is None else [_listed(mask) for mask in each],
        "loss": rule,
        "noise": {c: float(level) for c, level in noise.items()} if isinstance(noise, Mapping) else noise,
        "shared": list(asked.shared),
        "per_recording": list(asked.per_recording),
        "profiles": list(asked.profiles),
        "continuation": list(asked.continuation),
    }


def _pair(prior: PriorLike) -> tuple[float, float] | None:
    if isinstance(prior, Prior):
        return prior.mean, prior.std
    return None if prior is None else (prior[0], prior[1])


def _listed(mask: Mask | None) -> dict[str, list] | list | None:
    """A mask as lists of booleans."""
    if isinstance(mask, Mapping):
        return {column: np.asarray(rows).tolist() for column, rows in mask.items()}
    return None if mask is None else np.asarray(mask).tolist()
