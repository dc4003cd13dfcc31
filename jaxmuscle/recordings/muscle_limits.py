"""Limits of a McKibben muscle (how far its braid lets it go, how hard it pulls), and a recording beside its
card held against them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.actuators.variables import Check
from jaxmuscle.errors import Problems
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.card import Card
from jaxmuscle.units import RANGES, Series, from_si, meant

Fits = Callable[[float], bool]


@dataclasses.dataclass(frozen=True)
class Bench:
    """A card, samples in SI (pressures absolute), and where to note what is wrong with them.

    `row`: how the user calls the sample at an index.
    """

    rig: type[AbstractActuator]
    card: Card
    columns: Mapping[str, Series]
    step: float
    problems: Problems
    row: Callable[[int], str]

    def checked(self, check: Check) -> tuple[str, ...]:
        """The columns that the rig declares to be held to a check."""
        return tuple(name for name, column in self.rig.columns.items() if column.check == check)

    def value(self, name: str) -> float | None:
        """A quantity of the card in SI; `None` when it has none of that name."""
        given = self.card.quantities.get(name)
        return None if given is None else given.value

    def gauge(self, name: str) -> Series:
        """A column of pressures against the ambient one [Pa]."""
        return self.columns[name] - self.card.ambient_pressure

    def most(self, name: str) -> float:
        """The largest value of a column; of a pressure against the ambient one."""
        referenced = self.rig.column(name).referenced
        return float(np.nanmax(self.gauge(name) if referenced else self.columns[name]))

    def column(self, name: str) -> str:
        """How a message calls a column."""
        return f"column {self.card.columns[name].column!r} ({name})"

    def shown(self, name: str, value: float) -> str:
        """A value (SI; pressures gauge) in the unit of a column."""
        unit = self.card.columns[name].unit
        return f"{from_si(value, unit, self._si(name)):.4g} {unit}"

    def units_of_column(self, name: str, value: float, fits: Fits) -> str:
        """In which units a column with this value (SI; pressures gauge) would fit, for a message; or ""."""
        unit, si = self.card.columns[name].unit, self._si(name)
        likely = meant(from_si(value, unit, si), unit, si, fits)
        return likely and f"{likely} in {self.column(name)}"

    def units_of_quantity(self, name: str, fits: Fits) -> str:
        """The same for a quantity of the card, which is to stay within its range (pressures absolute)."""
        given, si = self.card.quantities.get(name), schema.quantities(self.rig)[name].unit
        if given is None:
            return ""
        shift = self.card.ambient_pressure if given.reference == "gauge" else 0.0
        _, low, high = RANGES.get(name, ("", -np.inf, np.inf))
        sound = lambda x: low <= x + shift <= high and fits(x + shift)  # noqa: E731
        likely = meant(from_si(given.value - shift, given.unit, si), given.unit, si, sound)
        return likely and f"{likely} of {name} in the card"

    def add(self, name: str, message: str, *likely: str) -> None:
        """Note what is wrong with a column, and the likely causes (those that are not "")."""
        causes = [cause for cause in likely if cause]
        self.problems.add(self.column(name), message + (f"; is it {', or '.join(causes)}?" if causes else ""))

    def _si(self, name: str) -> str:
        return schema.columns(self.rig)[name].unit


NAMES = ("initial_length", "initial_radius", "braid_angle", "end_factor")
BEYOND = 1.25
"""Contraction that is measured at most, relative to the largest by [T]: its sizes are not known better."""
OFFSET = 0.02
"""Offset of a position sensor at most, relative to the muscle's length."""


@dataclasses.dataclass(frozen=True)
class MuscleLimits:
    """The muscle of a card [m, m, rad, -]; equations as :class:`jaxmuscle.components.McKibben`, in NumPy."""

    initial_length: float
    initial_radius: float
    braid_angle: float
    end_factor: float

    @classmethod
    def of(cls, card: Card) -> MuscleLimits | None:
        """The muscle that a card describes; `None` if it describes none."""
        given = card.quantities
        return cls(*(given[name].value for name in NAMES)) if all(name in given for name in NAMES) else None

    @property
    def largest_contraction(self) -> float:
        r"""Contraction without force, [T] 8, and a quarter of it [m]: :math:`l_0 ε_{max}/\min(k, 1)`,
        :math:`ε_{max} = 1 - 1/(\sqrt3 \cosα_0)`.
        """
        ratio = 1 - 1 / (np.sqrt(3) * np.cos(self.braid_angle))
        return BEYOND * self.initial_length * float(ratio) / min(self.end_factor, 1.0)

    @property
    def largest_extension(self) -> float:
        r"""Extension at which the threads are straight, :math:`l_0 (1/\cosα_0 - 1)`, and an offset [m]."""
        return self.initial_length * float(1 / np.cos(self.braid_angle) - 1 + OFFSET)

    @property
    def offset(self) -> float:
        """Largest offset of a sensor of its contraction [m]."""
        return OFFSET * self.initial_length

    def force(self, contraction: Series | float, gauge_pressure: Series | float) -> Series | float:
        """Static force [N], [T] equations 4, 5 and 7."""
        a, b = 3 / np.tan(self.braid_angle) ** 2, 1 / np.sin(self.braid_angle) ** 2
        shortened = 1 - self.end_factor * contraction / self.initial_length
        return np.pi * self.initial_radius**2 * gauge_pressure * (a * shortened**2 - b)

    def carrying_contraction(self, weight: float, gauge_pressure: float) -> float:
        """Contraction at which a weight [N] hangs [m], [T] 4 and 7 solved for ε; 0 where it stays down."""
        if gauge_pressure <= 0:
            return 0.0
        a, b = 3 / np.tan(self.braid_angle) ** 2, 1 / np.sin(self.braid_angle) ** 2
        carried = weight / (np.pi * self.initial_radius**2 * gauge_pressure)
        return max(0.0, self.initial_length * float(1 - np.sqrt((carried + b) / a)) / self.end_factor)


ELSEWHERE = "another column"
LITTLE_TRAVEL = 10.0
"""Ratio of the contraction by [T] at the pressures measured to the largest one measured, at most."""


def check_contraction(bench: Bench, muscle: MuscleLimits) -> None:
    """Hold the position between a taut braid, or the base plate, and the contraction without force."""
    (position,) = bench.checked("lift") or bench.checked("contraction")
    low = -muscle.offset if bench.checked("lift") else -muscle.largest_extension
    high = muscle.largest_contraction
    values = bench.columns[position]
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    if low <= least and most <= high:
        return
    at = int(np.nanargmin(values)) if least < low else int(np.nanargmax(values))
    show = lambda value: bench.shown(position, value)  # noqa: E731
    what = (
        f"{show(float(values[at]))} of contraction in {bench.row(at)} cannot be: expected {show(low)} to "
        f"{show(high)} of a muscle of {show(muscle.initial_length)}"
    )
    if low <= -most and -least <= high:
        bench.add(position, f"{what}, shortening being positive", "of the opposite sign")
    elif most - least <= high - low:
        bench.add(position, f"{what}, from its full length on", "of another zero", ELSEWHERE)
    else:
        largest = max(abs(least), abs(most))
        in_reach = bench.units_of_column(position, largest, lambda x: 0.03 * high <= x <= high)
        long = lambda l0: largest <= high / muscle.initial_length * l0 <= 30 * largest  # noqa: E731
        bench.add(position, what, in_reach, bench.units_of_quantity("initial_length", long), ELSEWHERE)


def check_rise(bench: Bench, muscle: MuscleLimits, weight: float) -> None:
    """A mass that a quarter of the samples hold high by their pressure is not hardly off its plate."""
    (position,), (of_pressure,) = bench.checked("lift"), bench.checked("muscle pressure")
    pressure = float(np.nanquantile(bench.gauge(of_pressure), 0.75))
    expected = muscle.carrying_contraction(weight, pressure)
    most = bench.most(position)
    if expected < 0.1 * muscle.largest_contraction or most * LITTLE_TRAVEL > expected:
        return
    fits = lambda x: expected / 3 < x <= muscle.largest_contraction  # noqa: E731
    long = lambda l0: most / 3 < expected / muscle.initial_length * l0 < 3 * most  # noqa: E731
    bench.add(
        position,
        f"at most {bench.shown(position, most)} of contraction, where this muscle under this load shortens "
        f"by {bench.shown(position, expected)} at the {bench.shown(of_pressure, pressure)} gauge that a "
        f"quarter of the samples exceed",
        bench.units_of_column(position, most, fits) if most > 0 else "",
        bench.units_of_quantity("initial_length", long),
        ELSEWHERE,
    )


def check_angles(bench: Bench, muscle: MuscleLimits) -> None:
    """Hold the muscles of a joint to what their braid allows: x = ε0 l0 ± R θ."""
    radius, ratio = bench.value("sprocket_radius"), bench.value("initial_contraction")
    if radius is None or ratio is None:
        return
    middle = ratio * muscle.initial_length
    room = min(middle + muscle.largest_extension, muscle.largest_contraction - middle)
    if room <= 0:
        largest = muscle.largest_contraction / muscle.initial_length
        message = f"got {ratio:.3g}, but a muscle of this braid angle shortens by {largest:.2g} at most"
        bench.problems.add("initial_contraction in the card", message)
        return
    for name in bench.checked("joint angle"):
        values = bench.columns[name]
        at = int(np.nanargmax(np.abs(values)))
        largest = abs(float(values[at]))
        if largest * radius <= room:
            continue
        small = lambda r, most=largest: 0.03 * room <= most * r <= room  # noqa: E731
        bench.add(
            name,
            f"{bench.shown(name, float(values[at]))} in {bench.row(at)} cannot be: expected at most "
            f"{bench.shown(name, room / radius)} to either side, with muscles of "
            f"{muscle.initial_length:.3g} m on a sprocket of {radius:.3g} m",
            bench.units_of_column(name, largest, lambda x: x * radius <= room),
            bench.units_of_quantity("sprocket_radius", small),
            ELSEWHERE,
        )
