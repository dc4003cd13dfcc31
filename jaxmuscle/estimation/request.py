"""Arguments of a fit, checked before anything is computed; how priors and bounds are read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.free_parameters import Prior
from jaxmuscle.parameter_names import START
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


def read_prior(entry: PriorLike, where: str) -> Prior | None:
    """A prior as it was written; `None` for none.

    Raises:
        InputError: it is neither a pair of numbers nor `None`.
    """
    if entry is None or isinstance(entry, Prior):
        return entry
    mean, std = _pair(entry, where, "(mean, std)")
    if mean is None or std is None:
        raise InputError(f"{where}: expected (mean, std), or None for no prior; got {entry!r}")
    return Prior(mean, std)


def read_bounds(entry: Bounds, where: str) -> Bounds:
    """Bounds as they were written.

    Raises:
        InputError: they are not a pair of numbers, or of `None`.
    """
    return _pair(entry, where, "(lower, upper), None for none")


def _pair(entry: object, where: str, wanted: str) -> tuple[float | None, float | None]:
    pair = entry if isinstance(entry, Sequence) and not isinstance(entry, str) else ()
    if len(pair) == 2 and all(x is None or (_is_number(x) and not math.isnan(x)) for x in pair):
        low, high = (None if x is None else float(x) for x in pair)
        return low, high
    raise InputError(f"{where}: expected {wanted} in SI; got {entry!r}")


def given_recordings(actuator: object, recordings: object) -> tuple[Recording, ...]:
    """The recordings, one or several, beside a machine.

    Raises:
        InputError: no machine, or something that is no recording, or one without a row.
    """
    if not isinstance(actuator, AbstractActuator):
        raise InputError(
            f"actuator: expected a machine, such as jaxmuscle.actuator(recording.card) gives; "
            f"got {_kind(actuator)}"
        )
    if isinstance(recordings, Recording):
        recordings = (recordings,)
    if not isinstance(recordings, Sequence) or isinstance(recordings, str):
        raise InputError(_no_recording("recordings", recordings))
    for number, each in enumerate(recordings):
        if not isinstance(each, Recording):
            raise InputError(_no_recording(f"recordings[{number}]", each))
        if not len(each):
            raise InputError(f"recording {each.name!r} has no rows; leave it out")
    return tuple(recordings)


def names(given: Any, where: str) -> tuple[str, ...]:
    """A list of names as a tuple; `InputError` for a text or for anything that is no name."""
    if isinstance(given, str):
        raise InputError(f"{where}: expected a list of names; got the text {given!r}")
    found = _listed(given, where, "a list of names")
    for name in found:
        if not isinstance(name, str):
            raise InputError(f"{where}: expected a list of names; got {name!r} among them")
    return tuple(map(str, found))


def by_name(given: Any, where: str) -> dict[str, Any]:
    """A mapping from names, empty for `None`; `InputError` for anything else."""
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{where}: expected a mapping of names, such as {{'mass': …}}; got {given!r}")
    return dict(given)


def factors(given: Any, where: str) -> tuple[float, ...]:
    """A list of numbers; `InputError` for anything else."""
    found = _listed(given, where, "a list of numbers")
    if not all(_is_number(factor) for factor in found):
        raise InputError(f"{where}: expected a list of numbers; got {given!r}")
    return tuple(map(float, found))


def whole(given: Any, where: str, least: int) -> int:
    """A whole number from `least` on; `InputError` for anything else."""
    if isinstance(given, bool) or not isinstance(given, Integral) or int(given) < least:
        raise InputError(f"{where}: expected a whole number from {least} on; got {given!r}")
    return int(given)


def seconds(given: Any, where: str) -> float:
    """A length of time [s], infinite for `None`; `InputError` for anything else."""
    if given is None:
        return math.inf
    if isinstance(given, bool) or not _is_number(given) or not float(given) >= 0:
        raise InputError(f"{where}: expected a number of seconds, or None for no limit; got {given!r}")
    return float(given)


def _is_number(given: object) -> bool:
    """Whether it is a real number within the range of floating-point numbers."""
    if not isinstance(given, Real | np.number):
        return False
    try:
        float(given)
    except (TypeError, OverflowError):
        return False
    return True


def _listed(given: Any, where: str, wanted: str) -> list:
    try:
        return list(given)
    except TypeError as error:
        raise InputError(f"{where}: expected {wanted}; got {given!r}") from error


def _no_recording(where: str, got: object) -> str:
    return (
        f"{where}: expected recordings as jaxmuscle.read or jaxmuscle.recording gives them; got {_kind(got)}"
    )


def _kind(got: object) -> str:
    return repr(got) if isinstance(got, str | int | float | None) else f"a {type(got).__name__}"
