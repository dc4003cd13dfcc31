"""Values of options with units: ``NAME=VALUE,VALUE[:UNIT]``, in the unit of the card without one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.units import scale, to_si


@dataclasses.dataclass(frozen=True)
class Unit:
    """How numbers are written: `name` of the unit, `si`, and what is added in SI (gauge pressures).

    `ambient`: what would be added to a gauge one [Pa]; 0 of what is no pressure against ambient.
    """

    name: str
    si: str
    shift: float = 0.0
    ambient: float = 0.0

    @property
    def label(self) -> str:
        """The unit as a picture shows it."""
        return f"{self.name} gauge" if self.shift else self.name

    def to_si(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers as written, in SI."""
        return np.asarray(to_si(numbers, self.name, self.si)) + self.shift

    def from_si(self, values: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`to_si`."""
        zero = self.to_si(np.zeros(1))[0]
        return (np.asarray(values) - zero) / scale(self.name, self.si)


def split_option(text: str, option: str, form: str) -> tuple[str, str]:
    """Name and value of an option ``NAME=VALUE``.

    Args:
        option: what it is called; `form`: what it should look like, for the message.

    Raises:
        InputError: it has another form.
    """
    name, equals, body = text.partition("=")
    if not equals or not name or not body:
        raise InputError(f"{option} {text}: expected {form}")
    return name.strip(), body.strip()


def numbers_of(text: str, whole: str, form: str) -> np.ndarray:
    """The numbers of ``VALUE,VALUE``; `InputError` for what is none, `whole` and `form` for the message."""
    try:
        return np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise InputError(f"{whole}: expected {form}; {error}") from error


def values_of(body: str, whole: str, form: str, written: Unit) -> np.ndarray:
    """The finite numbers of ``VALUE,VALUE[:UNIT[:gauge|absolute]]`` in SI.

    Args:
        whole, form: the option and what it should look like, for the message.
        written: the unit in which numbers are without one of their own; its `shift` is that of a gauge
            pressure, where the quantity is a pressure.

    Raises:
        InputError: no finite numbers, no such unit, one of another kind.
    """
    numbers, unit = (
        numbers_of(body.split(":")[0], whole, form),
        _given(body.split(":")[1:], whole, form, written),
    )
    if not np.isfinite(numbers).all():
        raise InputError(f"{whole}: expected {form}, finite numbers")
    try:
        return unit.to_si(numbers)
    except InputError as error:
        raise InputError(f"{whole}: {error}") from error


def _given(rest: Sequence[str], whole: str, form: str, written: Unit) -> Unit:
    if len(rest) > 2 or (len(rest) == 2 and (rest[1] not in ("gauge", "absolute") or not written.ambient)):
        raise InputError(f"{whole}: expected {form}; do not know what {':'.join(rest)!r} is")
    if not rest:
        return written
    shift = written.shift if len(rest) < 2 else written.ambient if rest[1] == "gauge" else 0.0
    return dataclasses.replace(written, name=rest[0], shift=shift)
