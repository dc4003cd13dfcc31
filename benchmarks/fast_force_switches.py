"""The switches of the valves in the fixed-length recordings of `psu_isometric`, as sampled."""

from __future__ import annotations

import dataclasses

import numpy as np
import psu_isometric as psu
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from psu_isometric import Series

BEFORE, AFTER = 0.1, 0.36
"""Cut out around the first movement of the pressure [s]."""
JUDGED = (-0.005, 0.15)
SETTLED = (0.2, 0.35)
ONSET, SMALLEST = 3e3, 8e3
"""Movement of the pressure that counts as its beginning, and step that counts as a switch [Pa]."""
VENT_FROM, LATEST = 0.45, 0.1
"""When the exhaust opens in a period, at the earliest; by when the pressure must have moved [s]."""


@dataclasses.dataclass(frozen=True)
class Switch:
    """One pulse of a valve: samples around it, time from the first movement of the pressure."""

    filling: bool
    time: Series
    pressure: Series
    force: Series
    ends: tuple[tuple[float, float], tuple[float, float]]
    """Settled pressure and force before and after."""
    static: Polynomial = dataclasses.field(default_factory=lambda: Polynomial([0.0]))

    @property
    def judged(self) -> NDArray[np.bool_]:
        """The samples on which explanations are fitted and compared."""
        return (self.time > JUDGED[0]) & (self.time < JUDGED[1])

    @property
    def settled_error(self) -> float:
        """Mean square error of the static force after the ringing [N²]: what no explanation can remove."""
        late = (self.time > SETTLED[0]) & (self.time < SETTLED[1])
        return float(np.mean((self.static(self.pressure[late]) - self.force[late]) ** 2))


def switches(samples: tuple[Series, Series, Series]) -> list[Switch]:
    """All switches of a file with a muscle that stays taut; first those that fill, then those that vent.

    The static force is a cubic in the pressure through the settled points, one for filling, one for
    venting (the force at a length depends on where the pressure comes from). All switches of the file have
    a part in it, but none of their judged samples.
    """
    found = []
    for filling, offset in ((True, 0.0), (False, VENT_FROM)):
        begins = np.arange(psu.PERIOD + offset, samples[0][-1] - LATEST - AFTER, psu.PERIOD)
        cut = [s for begin in begins if (s := _cut(samples, begin, filling)) is not None]
        if cut:
            points = np.array([end for s in cut for end in s.ends]).T
            static = Polynomial.fit(*points, deg=min(3, len(cut)))
            found += [dataclasses.replace(s, static=static) for s in cut]
    return found


def _cut(samples: tuple[Series, Series, Series], begin: float, filling: bool) -> Switch | None:
    clock, pressure, force = samples
    rest = (clock > begin - 0.04) & (clock < begin)
    sign, start = (1 if filling else -1), float(np.median(pressure[rest]))
    moved = (clock > begin) & (clock < begin + LATEST) & (sign * (pressure - start) > ONSET)
    if not moved.any():
        return None
    onset = clock[np.argmax(moved)]
    rows = (clock > onset - BEFORE) & (clock < onset + AFTER)
    late = (clock > onset + SETTLED[0]) & (clock < onset + SETTLED[1])
    end = float(np.median(pressure[late]))
    if sign * (end - start) < SMALLEST or force[rows].min() < psu.SLACK:
        return None
    ends = ((start, float(force[rest].mean())), (end, float(force[late].mean())))
    return Switch(filling, clock[rows] - onset, pressure[rows], force[rows], ends)
