r"""Data sheets of muscles and valves, and what a card takes from them: ``type = "Festo DMSP-20"`` in
``[muscle]``.

What makers state stands in ``data_sheets.toml``, each number with its source. The parameters of the models
are either stated there or derived from it:

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
from typing import Any, TypeAlias

import numpy as np

from jaxmuscle.actuators import RIGS
from jaxmuscle.components.gas import GAMMA, GAS_CONSTANT
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.recordings import schema
from jaxmuscle.recordings.schema import Quantity, Rig, read_quantity
from jaxmuscle.units import STANDARD_ATMOSPHERE, from_si, to_si

Sources: TypeAlias = Mapping[str, tuple[str, ...]]
"""What a data sheet states → where."""
PARTS = ("muscle", "valve")
"""Parts of a machine that have data sheets; sections of a card."""
ANGLE_STD = np.radians(2.0)
"""Standard deviation of a braid angle that is derived from the force of a data sheet [rad].

Least-squares fits of [T] to the force maps that Martens and Boblan (Actuators 2017, 6(4), 33, appendix A)
measured, with the stated diameter, give 23.0 to 23.1° for a DMSP-10 (derived: 23.1°) and 25.5 to 26.8° for a
DMSP-20 (25.3°). The largest forces at 620 kPa of Bolen et al. (Actuators 2026, equations for 10 and 20 mm)
make it 24.0 to 24.4° and 26.8 to 27.5° for muscles of 0.3 to 0.5 m; shorter ones pull less: 26.7° at 0.112 m.
"""
END_FACTOR_STD = 0.5
"""Standard deviation of an end factor that is derived from the largest contraction of a data sheet [-].

The force maps of Martens and Boblan give 2.4 to 2.5 for a DMSP-10 (derived: 1.49), which is two of them off,
and 1.5 to 1.7 for a DMSP-20 (1.45): the bladder, which [T] leaves out, holds a thin muscle back.
"""
SHADOW_STD = np.radians(5.0), 0.15
"""Standard deviations of braid angle [rad] and end factor [-] of a muscle of which only the largest
contraction is stated.

It is a bound: the muscle of [T] (20°, 1.303), of the same build, contracts by 0.30 and lies two of them off.
"""
AREA_STD = 0.2
"""Standard deviation of an effective area that is derived from a nominal flow, relative to it [-].

With the critical pressure ratio 0.3 or 0.2 in place of an ideal nozzle's 0.528 a valve of the same nominal
flow passes 1.18 or 1.26 times as much where it is choked (ISO 6358); litres at 0 °C and 1.01325 bar weigh
1.09 times as much as those at 20 °C and 1 bar.
"""
LAG_STD = 0.4
"""Standard deviation of a time constant that is derived from a critical frequency, relative to it [-].

A spool of second order with a damping of 0.71 and the same -3 dB frequency trails a slow command by 1.41
times as much as the first-order spool of the model.
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
        value, unit: as a card would give it; `si`: its SI unit.
        std: standard deviation of it, `None` of one that is held fixed.
        derived: whether it is computed from what the source states, in place of being stated there.
        sources: where it, or what it is computed from, is stated.
    """

    value: float
    unit: str
    si: str
    std: float | None
    derived: bool
    sources: tuple[str, ...]

    def __str__(self) -> str:
        """The value with standard deviation and unit, as a person writes them."""
        spread = "" if self.std is None else f" ± {self.std:g}"
        return f"{self.value:g}{spread} {self.unit}".rstrip()

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

    @property
    def values(self) -> dict[str, float]:
        """Field of the part's model → value (SI): ``McKibben(initial_length=0.3, **sheet.values)``."""
        return {field: to_si(q.value, q.unit, q.si) for field, q in self.quantities.items()}


@functools.cache
def data_sheets() -> dict[str, dict[str, DataSheet]]:
    """All data sheets: part → type → data sheet."""
    text = files("jaxmuscle.recordings").joinpath("data_sheets.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    return {part: {name: _data_sheet(part, name, table) for name in table[part]} for part in PARTS}


def all_sources() -> tuple[str, ...]:
    """The sources of all data sheets, each once."""
    sheets = (sheet for each in data_sheets().values() for sheet in each.values())
    return tuple(dict.fromkeys(s for sheet in sheets for q in sheet.quantities.values() for s in q.sources))


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
    """The quantities of a rig's card that the data sheet of a part gives, by the names of the rig.

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


def name_in_cards(part: str, field: str) -> str:
    """How cards call a field of a part's model, by the first rig that has it."""
    paths = (rig.quantities.items() for rig in RIGS.values())
    return next((name for pairs in paths for name, path in pairs if path == f"{part}.{field}"), field)


def _data_sheet(part: str, name: str, table: Mapping[str, Any]) -> DataSheet:
    stated, further = table[part][name], []
    if "same_as" in stated:
        further = stated["same_as"]["source"]
        stated = table[part][stated["same_as"]["type"]]
    numbers = {key: to_si(float(entry["value"]), entry["unit"], SI[key]) for key, entry in stated.items()}
    sources = {
        key: tuple(table["sources"][each] for each in (*entry["source"], *further))
        for key, entry in stated.items()
    }
    derive = _muscle if part == "muscle" else _valve
    return DataSheet(part, name, derive(numbers, sources))


def _muscle(stated: Mapping[str, float], sources: Sources) -> dict[str, SheetQuantity]:
    """Parameters of a muscle; equations of the module, with k = 1 where no force is stated."""
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


def _valve(stated: Mapping[str, float], sources: Sources) -> dict[str, SheetQuantity]:
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


def _stated(value: float, unit: str, si: str, sources: tuple[str, ...]) -> SheetQuantity:
    return SheetQuantity(_digits(from_si(value, unit, si), 6), unit, si, None, False, sources)


def _derived(value: float, std: float, unit: str, si: str, sources: tuple[str, ...]) -> SheetQuantity:
    number, spread = (_digits(from_si(float(x), unit, si), n) for x, n in ((value, 3), (std, 2)))
    return SheetQuantity(number, unit, si, spread, True, sources)


def _digits(number: float, digits: int) -> float:
    return float(f"{number:.{digits}g}")


def _joined(sources: Sources, *keys: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(source for key in keys for source in sources[key]))
