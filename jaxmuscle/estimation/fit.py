"""Fit a machine to recordings: many starts, one best point, and how far it can be trusted."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.agreement import check_same_rig, conditions, labels
from jaxmuscle.estimation.conclude import conclude
from jaxmuscle.estimation.lane import Course
from jaxmuscle.estimation.layout import Asked, Bounds, PriorLike, layout
from jaxmuscle.estimation.losses import Loss, loss_named
from jaxmuscle.estimation.missing import Mask
from jaxmuscle.estimation.names import columns, expanded, places, resolve
from jaxmuscle.estimation.objective import Objective
from jaxmuscle.estimation.result import FitResult
from jaxmuscle.estimation.search import Search, search
from jaxmuscle.estimation.starts import given_starts, spread_starts
from jaxmuscle.estimation.stations import aligned, station
from jaxmuscle.recordings.recording import Recording

ESTIMATED = "estimated"
Masks = Mask | Sequence[Mask | None] | None


def _silent(message: str) -> None:
    """Progress that goes nowhere."""


def fit(
    actuator: AbstractActuator,
    recordings: Recording | Sequence[Recording],
    free: Sequence[str] | None = None,
    *,
    priors: Mapping[str, PriorLike] | None = None,
    bounds: Mapping[str, Bounds] | None = None,
    masks: Masks = None,
    loss: str | Loss = "squares",
    noise: str | Mapping[str, float] | None = None,
    starts: int | Sequence[Mapping[str, float]] = 1,
    shared: Sequence[str] = (),
    per_recording: Sequence[str] = (),
    profiles: Sequence[str] = (),
    budget: float | None = None,
    steps: int = 50,
    seed: int = 0,
    progress: Callable[[str], None] = _silent,
) -> FitResult:
    """Fit parameters of a machine and of the sensors to one or more recordings of its rig.

    Every recording is cut into windows of its card's horizon and each link of the chain predicts its output
    from its measured inputs, as in a diagnosis. Starts are first brought down on short parts of a window,
    where the cost is smooth, then on longer ones and on whole windows, with weights that allow for what the
    smoothed measured states leave uncertain. The error of the solver's steps is taken off where it matters.
    A known quantity on which the cards differ is each recording's own. The class of the actuator may be the
    user's own.

    Args:
        actuator: the machine; what is not free stays as it is there.
        recordings: as :func:`jaxmuscle.read` or :func:`jaxmuscle.recording` gives them; missing readings
            may be NaN.
        free: names of what is fitted: card quantities, paths, ``offset.COLUMN``, arrays (all their entries)
            and entries of arrays (``weights[3]``); what the cards call uncertain when `None`. Names in
            `shared` and `per_recording` are free too.
        priors: name → (mean, std) in SI, or `None` for no prior; in place of the card's.
        bounds: name → (lower, upper) in SI, `None` on a side without one.
        masks: rows that are bad: for one recording a boolean array or column → array; for several a
            sequence of these, `None` where nothing is bad.
        loss: "squares", "huber" or "student", or a :class:`~jaxmuscle.estimation.losses.Loss`.
        noise: column → standard deviation of its sensor, in place of the card's; "estimated" for the size of
            the residuals themselves; by default the card's, or what the fourth differences of the data show.
        starts: number of starts (the machine's own, then a Latin hypercube over the priors), or what each
            of them begins with.
        shared, per_recording: names with one value for all recordings (all are, by default), and with one
            for each.
        profiles: names whose profile likelihood is computed.
        budget: seconds after which the best so far is returned.
        steps: most steps of a start.
        seed: of the Latin hypercube.
        progress: called with a line of text at every iteration.

    Returns:
        a :class:`FitResult`.

    Raises:
        InputError: an unknown parameter, contradictory priors or bounds, too little usable data, all
            starts failed.
    """
    begin = time.monotonic()
    given = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    check_same_rig(actuator, given)
    names = labels(given)
    rule = loss_named(loss)
    asked = Asked(free, tuple(shared), tuple(per_recording), dict(priors or {}), dict(bounds or {}))
    unknowns = layout(actuator, given, names, asked)
    known = places(actuator, {})
    wanted = [p.name for name in profiles for p in expanded(known, resolve(known, name, "profiles"))]
    levels = {} if isinstance(noise, str) or noise is None else _checked(actuator, noise)
    if isinstance(noise, str) and noise != ESTIMATED:
        raise InputError(f"noise: expected {ESTIMATED!r} or a mapping of columns to values; got {noise!r}")
    machines = conditions(actuator, given, {e.place.path for e in unknowns.entries})
    stations = aligned(
        [
            station(machine, recording, name, mask, levels)
            for machine, recording, name, mask in zip(
                machines, given, names, _masks(masks, given), strict=True
            )
        ]
    )
    if isinstance(starts, int):
        if starts < 1:
            raise InputError(f"starts: expected a number from 1 on; got {starts}")
        points = spread_starts(unknowns, starts, seed)
    else:
        points = given_starts(unknowns, starts)
    task = Search(
        Objective(stations, unknowns, rule),
        points,
        steps,
        np.inf if budget is None else begin + budget,
        noise == ESTIMATED,
        _teller(progress, begin),
    )
    settings: dict[str, Any] = {
        "free": None if free is None else list(free),
        "priors": {name: _plain(prior) for name, prior in asked.priors.items()},
        "bounds": {name: tuple(pair) for name, pair in asked.bounds.items()},
        "loss": rule,
        "noise": dict(noise) if isinstance(noise, Mapping) else noise,
        "shared": list(shared),
        "per_recording": list(per_recording),
        "profiles": list(profiles),
        "steps": steps,
        "seed": seed,
    }
    return conclude(search(task), actuator, wanted, settings, progress, begin)


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


def _teller(progress: Callable[[str], None], begin: float) -> Callable[[str, Course], None]:
    def tell(stage: str, course: Course) -> None:
        lanes = f"{course.active} under way, {course.ended} ended, {course.waiting} waiting"
        progress(
            f"{stage}, iteration {course.iteration}: cost {course.cost:.6g} "
            f"({lanes}; {time.monotonic() - begin:.1f} s)"
        )

    return tell
