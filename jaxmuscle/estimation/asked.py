"""What the user asks of a fit, and how priors and bounds are read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.fitting.prior import Prior
from jaxmuscle.parameter_names import START

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
    if isinstance(entry, Sequence) and not isinstance(entry, str) and len(entry) == 2:
        numbers = [x is None or (isinstance(x, int | float | np.number) and not math.isnan(x)) for x in entry]
        if all(numbers):
            low, high = (None if x is None else float(x) for x in entry)
            return low, high
    raise InputError(f"{where}: expected {wanted} in SI; got {entry!r}")
