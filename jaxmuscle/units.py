"""Conversion between the units of a card and SI (the only place that knows pint), and the ranges in which
quantities of a laboratory lie.
"""

from __future__ import annotations

import functools
import math
import re
import tokenize
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import pint
from numpy.typing import NDArray

from jaxmuscle.errors import InputError, nearest

REGISTRY = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, on_redefinition="ignore")
# pint reads "Nm" as the textile unit "number meter".
REGISTRY.define("newton_meter = newton * meter = Nm")

STANDARD_ATMOSPHERE = 101325.0
"""Ambient pressure when a card gives none [Pa]."""

KINDS = {
    "Pa": ("a pressure", "bar"),
    "m": ("a length", "mm"),
    "s": ("a time", "ms"),
    "rad": ("an angle", "deg"),
    "N": ("a force", "N"),
    "kg": ("a mass", "kg"),
    "K": ("a temperature", "degC"),
    "K/s": ("a rate of a temperature", "K/s"),
    "Hz": ("a frequency", "Hz"),
    "V": ("a voltage", "V"),
    "A": ("a current", "mA"),
    "m^2": ("an area", "mm^2"),
    "m^3": ("a volume", "ml"),
    "m/s": ("a velocity", "mm/s"),
    "m/s^2": ("an acceleration", "m/s^2"),
    "s/m": ("a damping of a contact", "s/m"),
    "rad/s": ("an angular velocity", "deg/s"),
    "N m": ("a torque", "N m"),
    "kg/s": ("a mass flow", "g/s"),
    "m^3/s": ("a volume flow", "L/min"),
    "W": ("a power", "W"),
    "J": ("an energy", "J"),
    "kg m^2": ("a moment of inertia", "kg m^2"),
    "N s/m": ("a damping", "N s/m"),
    "N m s/rad": ("a damping", "N m s/rad"),
    "N/m": ("a stiffness", "N/mm"),
    "m/N": ("a compliance", "mm/N"),
    "W/K": ("a conductance of heat", "W/K"),
    "A/V": ("a gain of a current driver", "A/V"),
    "": ("a plain number", ""),
}
"""SI unit → what it measures, and an example of a unit for it."""

COMMON = (
    *"Pa hPa kPa MPa mbar bar psi atm m cm mm um inch s ms us min rad deg N kN lbf V mV A mA kg g".split(),
    *"K degC degF Hz kHz m^2 cm^2 mm^2 m/s mm/s".split(),
    *("N m", "kg m^2", "kg/s", "g/s", "L/min", "W", "J"),
)
"""Units that are suggested in place of one that does not exist."""

UNREADABLE = (
    pint.PintError,
    tokenize.TokenError,
    SyntaxError,
    ValueError,
    TypeError,
    ArithmeticError,
    AssertionError,
)
"""What pint raises on a text that is no unit."""

Series = NDArray[np.float64]
Value = TypeVar("Value", float, Series)


def to_si(value: Value, unit: str, si: str, difference: bool = False) -> Value:
    """A value or an array of values in `unit` as SI; offset units (degC) are points on their scale.

    Args:
        difference: whether it is a difference of such points: 1 degC is 1 K then.

    Raises:
        InputError: `unit` does not exist, or measures something else than `si` does.
    """
    check_unit(unit, si)
    magnitude = value * scale(unit, si) if difference else REGISTRY.Quantity(value, unit).to(si).magnitude
    return _plain(magnitude)


def from_si(value: float, unit: str, si: str) -> float:
    """The inverse of :func:`to_si`."""
    return float(REGISTRY.Quantity(value, si).to(unit).magnitude)


def scale(unit: str, si: str) -> float:
    """SI units per `unit`, for differences and standard deviations: 1 degC is 1 K there."""
    difference = REGISTRY.Quantity(1.0, unit) - REGISTRY.Quantity(0.0, unit)
    return float(difference.to(si).magnitude)


def check_unit(unit: str, si: str) -> None:
    """Raise `InputError` unless `unit` measures what `si` does."""
    measured = _roots(unit)
    if measured is not None and measured == _roots(si):
        return
    if measured is None:
        hint = _gauge_hint(unit) or nearest(unit, COMMON, all_if_none_near=False)
        raise InputError(f"expected {describe_unit(si)}; there is no unit {unit!r}{hint}")
    kinds = [f", which is {name}" for root, (name, _) in KINDS.items() if _roots(root) == measured]
    what = _gauge_hint(unit) or "".join(kinds[:1])
    raise InputError(f"expected {describe_unit(si)}; got unit = {unit!r}{what}")


def is_same_unit(one: str, other: str) -> bool:
    """Whether two units that exist measure the same."""
    return _roots(one) is not None and _roots(one) == _roots(other)


def describe_unit(si: str) -> str:
    """What an SI unit measures, with an example of how to write it."""
    return f'{KINDS.get(si, ("a quantity", si))[0]}, such as unit = "{example_unit(si)}"'


def example_unit(si: str) -> str:
    """A unit in which quantities of the SI unit are commonly written."""
    return KINDS.get(si, ("", si))[1]


LONGEST_UNIT = 60
"""Characters of a unit, far beyond any that is in use."""
POWER = re.compile(r"(\*\*|\^)(?!\s*\(?\s*[+-]?\d(\.\d{1,3})?(?![\d.])\s*\)?\s*(?!\s*(\*\*|\^)))")
"""A power whose exponent is no number of one digit. Pint computes what is written, however long that takes:
``2**2**2**99`` has no end."""
OF_NUMBER = re.compile(r"(?<![A-Za-z_\d.])[\d.]+\s*(\*\*|\^|[²³¹⁰⁴-⁹⁻])|[²³¹⁰⁴-⁹]{2}")
"""A power of a number, or one with an exponent of several raised digits."""
POWERS = re.compile(r"\*\*|\^")
MOST_POWERS = 6


def _is_harmless(unit: str) -> bool:
    """Whether pint reads a text at once, as it does everything that may be a unit."""
    if len(unit) > LONGEST_UNIT or len(POWERS.findall(unit)) > MOST_POWERS:
        return False
    return not (POWER.search(unit) or OF_NUMBER.search(unit))


@functools.lru_cache(maxsize=4096)
def _roots(unit: str) -> Any:
    """The unit in root units without its factor, `None` if it does not exist.

    Unlike pint's dimensions, root units tell rad/s from Hz and an angle from a plain number.
    """
    if not _is_harmless(unit):
        return None
    try:
        return REGISTRY.get_root_units(REGISTRY.parse_units(unit), check_nonmult=False)[1]
    except UNREADABLE:
        return None


def _gauge_hint(unit: str) -> str:
    """What to write in place of barg, bar(a), psig …; empty for anything else."""
    found = _with_reference(unit)
    return f'; write unit = "{found[0]}", reference = "{found[1]}"' if found else ""


def _with_reference(unit: str) -> tuple[str, str] | None:
    """barg, bar(a), psig … as a unit and a reference; `None` for anything else."""
    bare = unit.strip().rstrip(")").replace("(", "").replace("_", "").replace(" ", "").lower()
    for written in ("bar", "mbar", "psi", "kPa", "MPa"):
        for reference in ("gauge", "absolute"):
            if bare in (written.lower() + reference[0], written.lower() + reference[:3]):
                return written, reference
    return None


SIGNS = str.maketrans({"µ": "u", "μ": "u", "Ω": "ohm", "²": "^2", "³": "^3", "·": " ", "−": "-"})


def unit_in(text: str) -> tuple[str, str | None] | None:
    """(unit as a card has it, gauge or absolute if it says so) of a unit as laboratories write it.

    ``"°C"`` → degC, ``"µm"`` → um, ``"barg"`` → bar and gauge; `None` for what is no unit of a kind in
    :data:`KINDS`, a plain number among it.
    """
    bare = text.strip().strip("[]").strip().translate(SIGNS)
    bare = bare.replace("°C", "degC").replace("°F", "degF").replace("°", "deg")
    if (found := _with_reference(bare)) is not None:
        return found
    measured = _roots(bare) if any(character.isalpha() for character in bare) else None
    kinds = (_roots(si) for si in KINDS if si)
    return (bare, None) if measured is not None and any(measured == kind for kind in kinds) else None


def _plain(magnitude: Any) -> Any:
    return np.asarray(magnitude, dtype=float) if isinstance(magnitude, np.ndarray) else float(magnitude)


RANGES: dict[str, tuple[str, float, float]] = {
    "braid_angle": ("rad", math.radians(2), math.acos(1 / math.sqrt(3))),
    "initial_length": ("m", 1e-3, 20),
    "initial_radius": ("m", 1e-4, 0.5),
    "end_factor": ("", 0.1, 10),
    "initial_contraction": ("", -0.1, 0.5),
    "sprocket_radius": ("m", 5e-4, 2),
    "mass": ("kg", 1e-4, 1e5),
    "inertia": ("kg m^2", 1e-9, 1e5),
    "supply_pressure": ("Pa", 1e4, 5.2e6),
    "ambient_pressure": ("Pa", 1e4, 1e6),
    "gas_temperature": ("K", 200, 500),
    "polytropic_exponent": ("", 0.5, 2),
    "valve_area": ("m^2", 1e-10, 1e-2),
    "valve_time_constant": ("s", 1e-5, 10),
    "regulator_frequency": ("Hz", 1e-2, 1e4),
    "regulator_damping": ("", 1e-2, 1e2),
}
"""Quantity of a card → its SI unit, least and largest value of any bench, about ten times beyond those known.

The largest braid angle is 54.7°, beyond which a muscle lengthens under pressure ([T] equation 8).
"""
CANDIDATES: dict[str, tuple[str, ...]] = {
    "Pa": ("bar", "kPa", "MPa", "psi", "mbar", "Pa"),
    "m": ("mm", "cm", "m", "um", "inch"),
    "rad": ("deg", "rad"),
    "s": ("s", "ms", "us", "min"),
    "kg": ("kg", "g"),
    "N": ("N", "kN", "lbf"),
    "V": ("V", "mV"),
    "K": ("degC", "K", "degF"),
    "Hz": ("Hz", "kHz"),
    "m^2": ("mm^2", "cm^2", "m^2"),
    "kg m^2": ("kg m^2", "kg cm^2", "kg mm^2", "g cm^2"),
    "": ("", "percent"),
}
"""SI unit → units in which such numbers are commonly written, the likeliest first."""


def out_of_range(name: str, value: float, unit: str, si: str, shift: float = 0.0) -> str | None:
    """What is wrong with a quantity of a card, and the unit that is likely meant; `None` when nothing is.

    Args:
        name: quantity of the card; what is not in :data:`RANGES` may be anything.
        value: in SI, pressures absolute.
        unit: as the card has it; `si`: the SI unit of its rig.
        shift: ambient pressure of a gauge one [Pa].
    """
    kind, low, high = RANGES.get(name, (None, -math.inf, math.inf))
    if kind != si or low <= value <= high:
        return None
    ends = (from_si(max(end - shift, 0.0) if shift else end, unit, si) for end in (low, high))
    expected = " to ".join(f"{end:.3g}" for end in ends)
    number = from_si(value - shift, unit, si)
    likely = meant(number, unit, si, lambda x: low <= x + shift <= high)
    printed = " ".join(part for part in (f"{number:.6g}", unit) if part)
    return f"{printed} is not plausible; expected {expected} {unit}".rstrip() + (
        likely and f"; is it {likely}?"
    )


def meant(number: float, unit: str, si: str, fits: Callable[[float], bool]) -> str:
    """The units in which `number` would fit, such as ``unit = "mm" (or cm)``; "" when none is known.

    `fits`: whether a value in SI does.
    """
    fitting = [u for u in CANDIDATES.get(si, ()) if u != unit and fits(to_si(number, u, si))]
    return (
        f'unit = "{fitting[0]}"' + (f" (or {', '.join(fitting[1:3])})" if fitting[1:] else "")
        if fitting
        else ""
    )
