r"""Data sheets of muscles and valves, and what a card takes from them: ``type = "Festo DMSP-20"`` in
``[muscle]``.

What makers state stands in ``data_sheets.toml``, each number with its source. The parameters of the models are
either stated there or derived from it here:

.. math:: r_0 = \tfrac{d}{2}, \quad \tan^2α_0 = \frac{2}{1 + F/(π r_0^2 p)}, \quad
          k = \frac1{ε} \left(1 - \frac1{\sqrt3 \cosα_0}\right)

of a muscle of inner diameter d that pulls with F at the gauge pressure p where it is not contracted, and that
contracts by the ratio ε at most ([T] equations 5 and 8, which describe a muscle without a bladder), and

.. math:: A = \frac{ρ_n Q_n}{\dot m(p_1, p_2)/A}, \quad τ = \frac1{2π f}

of a valve of nominal flow :math:`Q_n` and critical frequency f.
"""

from __future__ import annotations

import dataclasses
import functools
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from jaxmuscle.components.gas import GAMMA, GAS_CONSTANT
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.schema import Quantity, Rig, read_quantity
from jaxmuscle.units import STANDARD_ATMOSPHERE, from_si, to_si

PARTS = ("muscle", "valve")
"""Parts of a machine that have data sheets; sections of a card."""
ANGLE_STD = np.radians(2.0)
"""Standard deviation of a braid angle that is derived from the force of a data sheet [rad].

Least-squares fits of [T] to the force maps that Martens and Boblan (Actuators 2017, 6(4), 33, appendix A)
measured, with the stated diameter, give 23.0 to 23.1° for a DMSP-10 (derived: 23.1°) and 25.5 to 26.8° for a
DMSP-20 (25.3°). The largest forces at 620 kPa of Bolen et al. (Actuators 2026, equations for 10 and 20 mm) make
it 24.0 to 24.4° and 26.8 to 27.5° for muscles of 0.3 to 0.5 m; shorter ones pull less: 26.7° at 0.112 m.
"""
END_FACTOR_STD = 0.5
"""Standard deviation of an end factor that is derived from the largest contraction of a data sheet [-].

The same maps give 2.4 to 2.5 for a DMSP-10 (derived: 1.49) and 1.5 to 1.7 for a DMSP-20 (1.45): the bladder, which
[T] leaves out, holds a thin muscle back below the pressure at which it contracts most.
"""
SHADOW_STD = np.radians(5.0), 0.15
"""Standard deviations of braid angle [rad] and end factor [-] of a muscle of which only the largest contraction is
stated. "Up to" is a bound: the muscle of [T] (20°, 1.303) of the same build, which contracts by 0.30, lies within
two of them.
"""
AREA_STD = 0.2
"""Standard deviation of an effective area that is derived from a nominal flow, relative to it [-].

A valve of critical pressure ratio 0.3 or 0.2 in place of an ideal nozzle's 0.528 passes 1.18 or 1.26 times as much
of the same nominal flow where it is choked (ISO 6358), and litres at 0 °C weigh 1.09 times as much as at 20 °C.
"""
LAG_STD = 0.4
"""Standard deviation of a time constant that is derived from a critical frequency, relative to it [-].

A spool of second order with a damping of 0.71 and the same -3 dB frequency trails a slow command by 1.41 times as
much as the first-order spool of the model.
"""
NORMAL_DENSITY = 1e5 / (GAS_CONSTANT * 293.15)
"""Density of air to which a nominal flow refers, 1 bar and 20 °C (ISO 8778), dry [kg/m^3]."""
NOMINAL_PRESSURES = 6e5 + STANDARD_ATMOSPHERE, 5e5 + STANDARD_ATMOSPHERE
"""Absolute pressures before and behind a valve to which a standard nominal flow refers [Pa]."""
SI = {
    "inner_diameter": "m",
    "force": "N",
    "pressure": "Pa",
    "contraction": "",
    "nominal_flow": "m^3/s",
    "critical_frequency": "Hz",
    "command_range": "V",
}
"""What a data sheet may state → its SI unit."""


@dataclasses.dataclass(frozen=True)
class SheetQuantity:
    """A parameter of a part's model.

    Attributes:
        value, unit: as a card would give it.
        std: standard deviation of it, `None` of one that is held fixed.
        derived: whether it is computed from what the source states, in place of being stated there.
        source: where it, or what it is computed from, is stated.
    """

    value: float
    unit: str
    std: float | None
    derived: bool
    source: str

    @property
    def entry(self) -> dict[str, Any]:
        """It as the entry of a card."""
        std = {} if self.std is None else {"std": self.std}
        return {"value": self.value, **std, "unit": self.unit}


@dataclasses.dataclass(frozen=True)
class DataSheet:
    """What is known of a type of muscle or valve.

    Attributes:
        part: one of :data:`PARTS`.
        type: as a card names it.
        quantities: field of the part's model (of :class:`~jaxmuscle.components.McKibben` or
            :class:`~jaxmuscle.components.FlowValve`) → what is known of it.
    """

    part: str
    type: str
    quantities: Mapping[str, SheetQuantity]


@functools.cache
def data_sheets() -> dict[str, dict[str, DataSheet]]:
    """All data sheets: part → type → data sheet."""
    text = files("jaxmuscle.recordings").joinpath("data_sheets.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    return {part: {name: _data_sheet(part, name, table) for name in table[part]} for part in PARTS}


def data_sheet(part: str, kind: object) -> DataSheet:
    """The data sheet of a type of a part; `InputError` when there is none."""
    known = data_sheets()[part]
    if not isinstance(kind, str):
        raise InputError(f"expected the name of a type, such as {next(iter(known))!r}; got {kind!r}")
    if kind not in known:
        raise InputError(
            f"unknown type {kind!r} (jaxmuscle init --types lists them; of any other give the quantities "
            f"themselves){nearest(kind, known)}"
        )
    return known[kind]


def sheet_quantities(rig: Rig, part: str, kind: object) -> dict[str, Quantity]:
    """The quantities of a rig's card that the data sheet of a part gives, by the names that the rig has for them.

    Raises:
        InputError: there is no such type, or the rig has no part that it could be.
    """
    sheet, needs = data_sheet(part, kind), schema.quantities(rig)
    names = {path: name for name, path in rig.quantities.items()}
    paths = {f"{part}.{field}": quantity for field, quantity in sheet.quantities.items()}
    found = {names[path]: quantity for path, quantity in paths.items() if path in names}
    if not found:
        raise InputError(
            f"rig {rig.rig!r} has no {part} of this kind: expected one with {' or '.join(paths)}; remove "
            f"[{part}], or name another rig"
        )
    return {
        name: read_quantity(quantity.entry, needs[name], STANDARD_ATMOSPHERE)
        for name, quantity in found.items()
    }


def _data_sheet(part: str, name: str, table: Mapping[str, Any]) -> DataSheet:
    stated, further = table[part][name], ""
    if "same_as" in stated:
        further = f"; {table['sources'][stated['same_as']['source']]}"
        stated = table[part][stated["same_as"]["type"]]
    numbers = {key: to_si(float(entry["value"]), entry["unit"], SI[key]) for key, entry in stated.items()}
    sources = {key: table["sources"][entry["source"]] + further for key, entry in stated.items()}
    derive = _muscle if part == "muscle" else _valve
    return DataSheet(part, name, derive(numbers, sources))


def _muscle(stated: Mapping[str, float], sources: Mapping[str, str]) -> dict[str, SheetQuantity]:
    """Parameters of a muscle; equations of the module. Without a stated force the ends are no hindrance, k = 1."""
    contraction = stated["contraction"]
    if "force" not in stated:
        angle = np.arccos(1 / (np.sqrt(3) * (1 - contraction)))
        of, (angle_std, ends_std) = sources["contraction"], SHADOW_STD
        return {
            "braid_angle": _derived(angle, angle_std, "deg", "rad", of),
            "end_factor": _derived(1.0, ends_std, "", "", of),
        }
    radius = stated["inner_diameter"] / 2
    ratio = stated["force"] / (np.pi * radius**2 * stated["pressure"])
    angle = np.arctan(np.sqrt(2 / (1 + ratio)))
    ends = (1 - 1 / (np.sqrt(3) * np.cos(angle))) / contraction
    pulled = _joined(sources, "inner_diameter", "force", "pressure")
    shortened = _joined(sources, "inner_diameter", "force", "pressure", "contraction")
    return {
        # Nominal. What pulls less or more than stated cannot be told from another braid angle by its force.
        "initial_radius": _stated(radius, "mm", "m", sources["inner_diameter"]),
        "braid_angle": _derived(angle, ANGLE_STD, "deg", "rad", pulled),
        "end_factor": _derived(ends, END_FACTOR_STD, "", "", shortened),
    }


def _valve(stated: Mapping[str, float], sources: Mapping[str, str]) -> dict[str, SheetQuantity]:
    """Parameters of a flow valve; equations of the module."""
    area = NORMAL_DENSITY * stated["nominal_flow"] / flow_per_area(*NOMINAL_PRESSURES, 293.15)
    found = {"area": _derived(area, AREA_STD * area, "mm^2", "m^2", sources["nominal_flow"])}
    if "critical_frequency" in stated:
        lag = 1 / (2 * np.pi * stated["critical_frequency"])
        found["time_constant"] = _derived(lag, LAG_STD * lag, "ms", "s", sources["critical_frequency"])
    half = stated["command_range"] / 2
    return {**found, "full_command": _stated(half, "V", "V", sources["command_range"])}


def flow_per_area(pressure_in: float, pressure_out: float, temperature: float) -> float:
    """Mass flow through an ideal nozzle that is not choked, by area [kg/(s m^2)].

    :func:`jaxmuscle.components.gas.nozzle_flow` in NumPy, for a table that is read before JAX is needed.
    """
    ratio = pressure_out / pressure_in
    root = ratio ** (2 / GAMMA) - ratio ** ((GAMMA + 1) / GAMMA)
    return pressure_in * float(np.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS_CONSTANT * temperature) * root))


def _stated(value: float, unit: str, si: str, source: str) -> SheetQuantity:
    return SheetQuantity(_digits(from_si(value, unit, si), 6), unit, None, False, source)


def _derived(value: float, std: float, unit: str, si: str, source: str) -> SheetQuantity:
    number, spread = (_digits(from_si(float(each), unit, si), 3) for each in (value, std))
    return SheetQuantity(number, unit, spread, True, source)


def _digits(number: float, digits: int) -> float:
    return float(f"{number:.{digits}g}")


def _joined(sources: Mapping[str, str], *keys: str) -> str:
    return "; ".join(dict.fromkeys(sources[key] for key in keys))
