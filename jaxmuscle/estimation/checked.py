"""Arguments of a fit that are not even of the right kind, told before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.recordings.recording import Recording


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
    if not all(isinstance(factor, Real) for factor in found):
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
    if isinstance(given, bool) or not isinstance(given, Real) or not float(given) >= 0:
        raise InputError(f"{where}: expected a number of seconds, or None for no limit; got {given!r}")
    return float(given)


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
