"""What the quantities of a bench can be at all, and which other unit would bring a number there."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxmuscle.recordings.units import from_si, to_si

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
