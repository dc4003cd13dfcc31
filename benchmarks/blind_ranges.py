"""Which effects a drawn machine may have, by rig, how large, and what its card must then declare (SI)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Effects = dict[str, dict[str, Any]]
Limits = tuple[float, float]
THREADS: dict[str, Limits] = {"static_coefficient": (0.015, 0.015), "kinetic_coefficient": (0.05, 0.12),
                              "velocity_constant": (0.1, 0.2)}  # fmt: skip
MUSCLE: dict[str, dict[str, Any]] = {
    "thread_friction": THREADS,
    "length_hysteresis": {"weight": (0.1, 0.6), "asymmetry": (-0.15, 0.15), "density_width": (0.1, 0.1)},
    "bladder_stiffness": {"stiffness": (300, 1500), "threshold_pressure": (2e4, 6e4)},
    "bladder_hoop_stiffness": {"wall_stiffness": (5, 30)},
    "pressure_dependent_ends": {"amplitude": (0.8, 4)},
    "wall_thickness": {"thickness": (2e-4, 1e-3)},
    "creep": {"stiffness": (200, 800), "fast_time": (0.1, 0.6), "slow_time": (2, 8)},
    "force_drift": {"share": (0.03, 0.2), "time_constant": (5, 20)},
}
MOTION = {
    "presliding": {"distance": (2e-4, 1.5e-3)},
    "backlash": {"half_width": (3e-4, 3e-3)},
}


def _sensors(gain: Limits, **columns: tuple[Limits, Limits]) -> dict[str, dict[str, Any]]:
    """Errors of the sensors of `columns`: offset, and drift per second; gains are of all columns alike."""
    return {
        "sensor_gain": {"gain": dict.fromkeys(columns, gain)},
        "sensor_offset": {"offset": {column: offset for column, (offset, _) in columns.items()}},
        "sensor_drift": {"rate": {column: rate for column, (_, rate) in columns.items()}},
    }


RANGES: dict[str, dict[str, dict[str, Any]]] = {
    "driven": MUSCLE
    | {
        "force_sensor_lag": {"time_constant": (5e-3, 5e-2)},
        "force_sensor_nonlinearity": {"cubic": (2e-8, 2e-7)},
    }
    | _sensors(
        (0.01, 0.05),
        force=((4, 40), (0.1, 1.0)),
        pressure=((2e3, 2e4), (50, 500)),
        position=((2e-4, 2e-3), (5e-6, 5e-5)),
    ),
    "isotonic": MUSCLE
    | MOTION
    | {
        "load_friction": {"force": (4, 30)},
        "stribeck": {"excess": (4, 30), "velocity_constant": (5e-3, 3e-2)},
        "load_damping": {"coefficient": (15, 200)},
        "end_stop": {"stiffness": (1e3, 1e4), "position": (0.03, 0.06)},
        "chamber_leak": {"area": (2e-8, 2e-7)},
        "command_delay": {"delay": (4e-3, 3e-2)},
        "dead_band": {"width": (0.1, 0.5)},
        "valve_offset": {"offset": (0.05, 0.25)},
        "valve_hysteresis": {"half_width": (0.1, 0.6)},
        "rate_limit": {"inverse_rate": (3e-3, 3e-2)},
        "supply_droop": {"resistance": (1e7, 1e8)},
        "line_lag": {"time_constant": (3e-3, 3e-2)},
        "dead_volume": {"volume": (3e-6, 3e-5)},
        "gas_heating": {"share": (0.3, 1.0), "thermal_time": (0.1, 1.0)},
        "pressure_sensor_lag": {"time_constant": (3e-3, 3e-2)},
    }
    | _sensors((0.01, 0.05), pressure=((2e3, 2e4), (100, 1000)), position=((2e-4, 2e-3), (1e-5, 1e-4))),
    "joint": MUSCLE
    | {name: {p: (low * 15, high * 15) for p, (low, high) in of.items()} for name, of in MOTION.items()}
    | {
        "load_friction": {"force": (0.05, 0.5)},
        "stribeck": {"excess": (0.05, 0.5), "velocity_constant": (0.05, 0.3)},
        "load_damping": {"coefficient": (0.02, 0.15)},
        "gravity": {"torque": (0.2, 1.5), "hanging_angle": (-0.5, 0.5)},
        "end_stop": {"stiffness": (1, 20), "position": (0.05, 0.2)},
        "eccentric_sprocket": {"eccentricity": (0.01, 0.1), "phase": (-3.1, 3.1), "wrap_angle": (0.0, 3.1)},
        "muscle_mismatch": {"ratio": (-0.08, 0.08)},
        "command_delay": {"delay": (4e-3, 3e-2)},
        "valve_offset": {"offset": (2e3, 2e4)},
        "valve_hysteresis": {"half_width": (2e3, 2e4)},
        "rate_limit": {"inverse_rate": (2e-7, 2e-6)},
        "pressure_sensor_lag": {"time_constant": (3e-3, 3e-2)},
    }
    | _sensors(
        (0.01, 0.05),
        pressure_1=((2e3, 2e4), (100, 1000)),
        pressure_2=((2e3, 2e4), (100, 1000)),
        angle=((4e-3, 4e-2), (2e-4, 2e-3)),
    ),
    "jet-pipe": {
        "command_delay": {"delay": (2e-3, 2e-2)},
        "dead_band": {"width": (0.02, 0.2)},
        "current_saturation": {"inverse_limit": (6, 14)},
        "valve_hysteresis": {"weight": (0.1, 0.8), "width": (0.05, 0.25)},
        "chamber_leak": {"area": (2e-8, 2e-7)},
        "force_sensor_lag": {"time_constant": (3e-3, 3e-2)},
        "force_sensor_nonlinearity": {"cubic": (4e-6, 4e-5)},
    }
    | _sensors((0.01, 0.05), force=((1, 10), (0.05, 0.5)), current=((2e-3, 2e-2), (1e-4, 1e-3))),
}
"""Rig → effect → range of each parameter (by column for a sensor's error), evenly drawn."""


def _misread(times: Limits, **columns: tuple[Limits, Limits]) -> dict[str, dict[str, Any]]:
    """Errors of the sensors of `columns` that the catalogue does not have: sizes, pitches of a ripple."""
    sizes = {column: size for column, (size, _) in columns.items()}
    return {
        "hum": {"size": sizes, "frequency": (0.5, 10)},
        "zero_jump": {"size": sizes, "time": times},
        "reading_ripple": {"size": sizes, "pitch": {column: pitch for column, (_, pitch) in columns.items()}},
    }


OUTSIDE: dict[str, dict[str, dict[str, Any]]] = {
    "driven": {
        "cogging": {"force": (4, 30), "pitch": (5e-3, 1.5e-2)},
        "shaking": {"force": (4, 30), "frequency": (0.5, 10)},
        "added_weight": {"force": (4, 30), "time": (10, 35)},
    }
    | _misread((10, 35), force=((4, 30), (30, 100))),
    "isotonic": {
        "cogging": {"force": (4, 20), "pitch": (5e-3, 1.5e-2)},
        "air_drag": {"coefficient": (100, 1000)},
        "shaking": {"force": (2, 15), "frequency": (0.5, 8)},
        "added_weight": {"force": (4, 20), "time": (4, 12)},
        "supply_swing": {"share": (0.03, 0.15), "frequency": (0.1, 2)},
    }
    | _misread((4, 12), position=((2e-4, 2e-3), (5e-3, 2e-2)), pressure=((2e3, 2e4), (5e4, 2e5))),
    "joint": {
        "cogging": {"force": (0.1, 0.6), "pitch": (0.1, 0.3)},
        "air_drag": {"coefficient": (0.01, 0.1)},
        "shaking": {"force": (0.1, 0.6), "frequency": (0.5, 8)},
        "added_weight": {"force": (0.1, 0.6), "time": (4, 12)},
    }
    | _misread((4, 12), angle=((4e-3, 2e-2), (0.1, 0.4))),
    "jet-pipe": _misread((1, 3), force=((1, 10), (20, 60)), current=((2e-3, 2e-2), (2e-2, 1e-1))),
}
"""The same of causes that the catalogue does not have, which a diagnosis has to admit; drawn where named."""
SIZES = {
    "thread_friction": ("static_coefficient", "kinetic_coefficient"), "length_hysteresis": ("weight",),
    "bladder_stiffness": ("stiffness",), "bladder_hoop_stiffness": ("wall_stiffness",),
    "pressure_dependent_ends": ("amplitude",), "wall_thickness": ("thickness",), "creep": ("stiffness",),
    "force_drift": ("share",), "presliding": ("distance",), "backlash": ("half_width",),
    "force_sensor_lag": ("time_constant",), "force_sensor_nonlinearity": ("cubic",),
    "pressure_sensor_lag": ("time_constant",), "load_friction": ("force",), "stribeck": ("excess",),
    "load_damping": ("coefficient",), "end_stop": ("stiffness",), "gravity": ("torque",),
    "eccentric_sprocket": ("eccentricity",), "muscle_mismatch": ("ratio",), "chamber_leak": ("area",),
    "command_delay": ("delay",), "dead_band": ("width",), "valve_offset": ("offset",),
    "valve_hysteresis": ("half_width", "weight"), "rate_limit": ("inverse_rate",),
    "supply_droop": ("resistance",), "line_lag": ("time_constant",), "dead_volume": ("volume",),
    "gas_heating": ("share",), "current_saturation": ("inverse_limit",), "sensor_gain": ("gain",),
    "sensor_offset": ("offset",), "sensor_drift": ("rate",),
    "cogging": ("force",), "air_drag": ("coefficient",), "shaking": ("force",), "added_weight": ("force",),
    "supply_swing": ("share",), "hum": ("size",), "zero_jump": ("size",), "reading_ripple": ("size",),
}  # fmt: skip
"""Parameters that make an effect as large as it is; they are drawn smaller together."""
SIGNED = (
    "sensor_gain", "sensor_offset", "sensor_drift", "valve_offset", "force_sensor_nonlinearity",
    "added_weight", "zero_jump",
)  # fmt: skip
"""Effects whose size has either sign."""
SMALLEST = 0.03
"""How much smaller at most, evenly in the logarithm: the largest are plain to see, the smallest are not."""
SMALLEST_OUTSIDE = 0.3
"""The same of causes outside the catalogue: what cannot be seen tells nothing of how they are taken."""
NEEDED: dict[str, dict[str, dict[str, Limits]]] = {
    "isotonic": {"thread_friction": THREADS, "load_friction": {"force": (8, 20)}},
    "joint": {"thread_friction": THREADS, "load_friction": {"force": (0.1, 0.3)}},
}
"""Dry friction that a card declares: of the threads always, of the load where the truth changes its law."""
RESTS_ON_FRICTION = ("presliding", "stribeck")
BRISTLES = {"driven": (1e-5, 4e-5), "isotonic": (1e-5, 4e-5), "joint": (1e-4, 6e-4)}
"""Distance over which dry friction builds up on a rough bench (m, rad), evenly in the logarithm."""
ROUGH_SHARE = 1 / 3


def offered(rig: str, names: Sequence[str] = ()) -> list[str]:
    """What may be drawn for a rig: its effects, or those of `names` that it may have, outsiders too."""
    return sorted(set(names) & {*RANGES[rig], *OUTSIDE[rig]} if names else RANGES[rig])


def truth_of(rig: str, names: Sequence[str], draw: np.random.Generator) -> Effects:
    """Effects of these names, their parameters and sizes drawn."""
    sought, outside = RANGES[rig], OUTSIDE[rig]
    return {
        name: _drawn(name, sought[name], SMALLEST, draw)
        if name in sought
        else _drawn(name, outside[name], SMALLEST_OUTSIDE, draw)
        for name in names
    }


def declared_of(rig: str, truth: Mapping[str, Any], draw: np.random.Generator) -> Effects:
    """Dry friction that a card declares beside what is missing there."""
    changed = any(name in truth for name in RESTS_ON_FRICTION)
    wanted = {"thread_friction": True, "load_friction": changed}
    return {
        name: between(ranges, draw)
        for name, ranges in NEEDED.get(rig, {}).items()
        if wanted[name] and name not in truth
    }


def between(ranges: Mapping[str, Limits], draw: np.random.Generator) -> dict[str, float]:
    return {name: float(draw.uniform(*limits)) for name, limits in ranges.items()}


def _drawn(
    name: str, ranges: Mapping[str, Any], smallest: float, draw: np.random.Generator
) -> dict[str, Any]:
    chosen = dict(ranges)
    found: dict[str, Any] = {}
    for parameter, limits in ranges.items():
        if isinstance(limits, dict):
            if "column" not in found:
                found["column"] = str(draw.choice(sorted(limits)))
            chosen[parameter] = limits[found["column"]]
    share = float(np.exp(draw.uniform(np.log(smallest), 0.0)))
    share *= float(draw.choice([-1, 1])) if name in SIGNED else 1.0
    values = between(chosen, draw)
    return found | {p: share * value if p in SIZES[name] else value for p, value in values.items()}


def label(name: str, parameters: Mapping[str, Any]) -> str:
    """What a result calls it: an error of a sensor has the name of its column at the end."""
    return f"{name}_{parameters['column']}" if "column" in parameters else name
