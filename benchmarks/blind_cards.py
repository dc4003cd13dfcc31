"""Cards of drawn recordings, as an experimenter would write them, and what they are unsure of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from blind_ranges import Effects

from jaxmuscle.recordings.card import Card

NOISE = {"driven": {"force": 0.8}, "isotonic": {"pressure": 400.0, "position": 3e-5},
         "joint": {"pressure_1": 400.0, "pressure_2": 400.0, "angle": 4e-4},
         "jet-pipe": {"current": 5e-4, "force": 0.2}}  # fmt: skip
UNITS = {
    "ambient_pressure": "Pa", "initial_length": "m", "initial_radius": "m", "braid_angle": "rad",
    "valve_area": "m^2", "valve_time_constant": "s", "full_command": "V", "gas_temperature": "K",
    "mass": "kg", "regulator_frequency": "Hz", "sprocket_radius": "m", "inertia": "kg m^2",
    "velocity_constant": "m/s", "current_gain": "A/V", "stopper_position": "m", "residual_force": "N",
    "pipe_compliance": "m/N", "pipe_saturation_force": "N", "receiver_offset": "m",
}  # fmt: skip
"""Of the quantities that a card names; what is not here has none."""
ABSOLUTE = ("supply_pressure", "initial_pressure")
UNCERTAIN = {
    "driven": {"initial_radius": 1e-4, "end_factor": 0.05},
    "isotonic": {"valve_area": 2e-7, "valve_time_constant": 1e-3, "end_factor": 0.05},
    "joint": {"regulator_frequency": 1.5, "end_factor": 0.05, "inertia": 0.02},
    "jet-pipe": {"pipe_compliance": 4e-5, "receiver_offset": 1e-5, "discharge_coefficient": 0.03},
}
"""What a card calls uncertain, and its standard deviation."""
FRICTION_STDS = {
    "isotonic": {
        "static_coefficient": 0.004,
        "kinetic_coefficient": 0.02,
        "velocity_constant": 0.04,
        "force": 2.0,
    },
    "joint": {
        "static_coefficient": 0.004,
        "kinetic_coefficient": 0.02,
        "velocity_constant": 0.04,
        "force": 0.03,
    },
}
"""Of what a card declares."""


def stds_of(rig: str, declared: Effects) -> dict[str, float]:
    """Standard deviations of what the card is unsure of, by the name of a constant or "effect.parameter"."""
    frictions = FRICTION_STDS.get(rig, {})
    of_effects = {
        f"{e}.{n}": frictions[n] for e, values in declared.items() for n in values if n in frictions
    }
    return {**UNCERTAIN[rig], **of_effects}


def off_by(
    machine: Mapping[str, float], effects: Effects, stds: Mapping[str, float], off: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Constants and effects, off by so many standard deviations each."""
    constants = {n: v + stds[n] * off[n] if n in off else v for n, v in machine.items()}
    moved = {
        e: {n: v + stds[f"{e}.{n}"] * off[f"{e}.{n}"] if f"{e}.{n}" in off else v for n, v in values.items()}
        for e, values in effects.items()
    }
    return constants, moved


def card_of(rig: str, machine: Mapping[str, float], declared: Effects, draw: np.random.Generator) -> Card:
    """As an experimenter would write it: what is uncertain is off by its standard deviation, normally."""
    absolute = {"unit": "Pa", "reference": "absolute"}
    units_of = {**UNITS, "force": "N m" if rig == "joint" else "N"}

    def section(values: Mapping[str, float], stds: Mapping[str, float]) -> dict[str, Any]:
        found = {}
        for name, value in values.items():
            std = stds.get(name)
            off = 0.0 if std is None else float(np.clip(draw.normal(), -2, 2)) * std
            unit = absolute if name in ABSOLUTE else {"unit": units_of.get(name, "")}
            found[name] = {"value": value + off, **unit, **({} if std is None else {"std": std})}
        return found

    stds = UNCERTAIN[rig]
    units = {"position": "m", "force": "N", "angle": "rad", "command": "V", "time": "s", "current": "A"}
    names = ["time", *columns_of(rig)]
    gauge = {"unit": "Pa", "reference": "gauge"}
    columns = {n: {"column": n, **({"unit": units[n]} if n in units else gauge)} for n in names}
    skipped = {"ambient_pressure"} if rig in ("driven", "joint") else set()
    known = {n: v for n, v in machine.items() if n not in stds and n not in skipped}
    return Card.parse(
        {
            "rig": rig,
            "columns": columns,
            "known": section(known, {}),
            "uncertain": section({n: machine[n] for n in stds}, stds),
            "noise": {n: {"value": size, "unit": units.get(n, "Pa")} for n, size in NOISE[rig].items()},
            "effects": {name: section(values, FRICTION_STDS[rig]) for name, values in declared.items()},
            **({} if rig == "driven" else {"fit": {"horizon": {"value": 1, "unit": "s"}}}),
        }
    )


def columns_of(rig: str) -> list[str]:
    if rig == "driven":
        return ["pressure", "position", "force"]
    if rig == "isotonic":
        return ["command", "pressure", "position"]
    if rig == "jet-pipe":
        return ["command", "current", "force"]
    return ["command_1", "command_2", "pressure_1", "pressure_2", "angle"]
