"""From the arguments of a fit to what is minimised and where it begins; what is wrong with them is told."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.agreement import check_same_rig, conditions, labels
from jaxmuscle.estimation.asked import Asked, PriorLike
from jaxmuscle.estimation.layout import known_places, layout
from jaxmuscle.estimation.losses import Loss
from jaxmuscle.estimation.missing import Mask
from jaxmuscle.estimation.names import columns, expanded, resolve
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.padding import aligned
from jaxmuscle.estimation.starts import given_starts, spread_starts
from jaxmuscle.estimation.stations import station
from jaxmuscle.estimation.unknowns import Unknowns
from jaxmuscle.recordings.recording import Recording

ESTIMATED = "estimated"
Masks = Mask | Sequence[Mask | None] | None
NoiseLike = str | Mapping[str, float] | None


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
    profiled(actuator, recordings, asked)
    if isinstance(noise, str) and noise != ESTIMATED:
        raise InputError(f"noise: expected {ESTIMATED!r} or a mapping of columns to values; got {noise!r}")
    levels = _checked(actuator, noise) if isinstance(noise, Mapping) else {}
    machines = conditions(actuator, recordings, {e.place.path for e in unknowns.entries})
    parts = zip(machines, recordings, names, _masks(masks, recordings), strict=True)
    return Objective(aligned([station(*part, levels) for part in parts]), unknowns, rule)


def profiled(actuator: AbstractActuator, recordings: Sequence[Recording], asked: Asked) -> list[str]:
    """The names of all places whose profile is asked for."""
    known = known_places(actuator, recordings, asked)[0]
    return [p.name for name in asked.profiles for p in expanded(known, resolve(known, name, "profiles"))]


def widths(continuation: Sequence[float]) -> tuple[float, ...]:
    """The factors of a continuation, checked: above 1 and falling."""
    found = tuple(float(factor) for factor in continuation)
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
    if not isinstance(starts, int):
        return given_starts(unknowns, starts)
    if starts < 1:
        raise InputError(f"starts: expected a number from 1 on; got {starts}")
    return spread_starts(unknowns, starts, seed)


def as_settings(asked: Asked, rule: Loss, noise: NoiseLike) -> dict[str, Any]:
    """The arguments with which the same can be asked for again, as plain data."""
    return {
        "free": None if asked.free is None else list(asked.free),
        "priors": {name: _plain(prior) for name, prior in asked.priors.items()},
        "bounds": {name: tuple(pair) for name, pair in asked.bounds.items()},
        "loss": rule,
        "noise": dict(noise) if isinstance(noise, Mapping) else noise,
        "shared": list(asked.shared),
        "per_recording": list(asked.per_recording),
        "profiles": list(asked.profiles),
        "continuation": list(asked.continuation),
    }


def _plain(prior: PriorLike) -> tuple[float, float] | None:
    return prior if prior is None or isinstance(prior, tuple) else dataclasses.astuple(prior)  # pyright: ignore


def _checked(actuator: AbstractActuator, noise: Mapping[str, float]) -> dict[str, float]:
    sensors = {column: column for column in columns(actuator)}
    for column, level in noise.items():
        if column not in sensors:
            raise InputError(f"noise: unknown column {column!r}; expected one of {', '.join(sensors)}")
        if not 0 < level < np.inf:
            raise InputError(f"noise[{column!r}]: expected a standard deviation above zero (SI); got {level}")
    return dict(noise)


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
