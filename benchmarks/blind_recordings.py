"""Fresh random recordings whose truth is drawn: machine, card, motion, what the card does not say, noise.

Readings come from the one-page oracles of the tests, which share no code with the models.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles.driven import driven  # pyright: ignore[reportMissingImports]
from oracles.isotonic import isotonic  # pyright: ignore[reportMissingImports]
from oracles.joint import joint  # pyright: ignore[reportMissingImports]

AMBIENT = 101325.0
Series = NDArray[np.float64]
Effects = dict[str, dict[str, float]]
THREADS = {"static_coefficient": (0.015, 0.015), "kinetic_coefficient": (0.05, 0.12),
           "velocity_constant": (0.1, 0.2)}  # fmt: skip
MUSCLE: dict[str, dict[str, tuple[float, float]]] = {
    "thread_friction": THREADS,
    "length_hysteresis": {"weight": (0.04, 0.16), "asymmetry": (-0.15, 0.15), "density_width": (0.1, 0.1)},
    "bladder_stiffness": {"stiffness": (300, 1500), "threshold_pressure": (2e4, 6e4)},
    "bladder_hoop_stiffness": {"wall_stiffness": (5, 30)},
    "pressure_dependent_ends": {"amplitude": (0.8, 4)},
}
"""Effect → range of each parameter (SI), evenly drawn."""
RANGES = {
    "driven": MUSCLE,
    "isotonic": MUSCLE
    | {
        "load_friction": {"force": (4, 30)},
        "load_damping": {"coefficient": (15, 200)},
        "chamber_leak": {"area": (2e-8, 2e-7)},
        "command_delay": {"delay": (4e-3, 3e-2)},
    },
    "joint": MUSCLE
    | {
        "load_friction": {"force": (0.05, 0.5)},
        "load_damping": {"coefficient": (0.02, 0.15)},
        "gravity": {"torque": (0.2, 1.5), "hanging_angle": (-0.5, 0.5)},
        "muscle_mismatch": {"ratio": (-0.08, 0.08)},
        "command_delay": {"delay": (4e-3, 3e-2)},
    },
}
SIZES = ("static_coefficient", "kinetic_coefficient", "weight", "stiffness", "wall_stiffness", "amplitude",
         "force", "coefficient", "area", "delay", "torque", "ratio")  # fmt: skip
"""Parameters that make an effect as large as it is; they are drawn smaller together."""
SMALLEST = 0.03
"""How much smaller at most, evenly in the logarithm: the largest are plain to see, the smallest are not."""
STEPS = {"driven": 0.01, "isotonic": 2e-3, "joint": 2e-3}
SECONDS = {"driven": 60.0, "isotonic": 20.0, "joint": 20.0}
SUBSTEPS = {"isotonic": 6, "joint": 6}
NOISE = {"driven": {"force": 0.8}, "isotonic": {"pressure": 400.0, "position": 3e-5},
         "joint": {"pressure_1": 400.0, "pressure_2": 400.0, "angle": 4e-4}}  # fmt: skip
UNITS = {
    "ambient_pressure": "Pa", "initial_length": "m", "initial_radius": "m", "braid_angle": "rad",
    "valve_area": "m^2", "valve_time_constant": "s", "full_command": "V", "gas_temperature": "K",
    "mass": "kg", "regulator_frequency": "Hz", "sprocket_radius": "m", "inertia": "kg m^2",
    "velocity_constant": "m/s",
}  # fmt: skip
"""Of the quantities that a card names; what is not here has none."""
UNCERTAIN = {
    "driven": {"initial_radius": 1e-4, "end_factor": 0.05},
    "isotonic": {"valve_area": 2e-7, "valve_time_constant": 1e-3, "end_factor": 0.05},
    "joint": {"regulator_frequency": 1.5, "end_factor": 0.05, "inertia": 0.02},
}
"""What a card calls uncertain, and its standard deviation."""
THREAD_STDS = {"static_coefficient": 0.004, "kinetic_coefficient": 0.02, "velocity_constant": 0.04}


@dataclasses.dataclass(frozen=True)
class Blind:
    """A recording and its truth.

    Attributes:
        truth: effects that are there and not on the card, with their parameters.
        noise: "white", or "coloured": as much again, correlated over a tenth of a second to two.
        shift: root mean square change of a reading by the truth over its noise; the largest of all readings.
    """

    recording: Recording
    truth: Effects
    noise: str
    shift: float


def drawn(seed: int, rig: str, effects: int, coloured: bool) -> Blind:
    """The recording of a seed, which lacks so many effects."""
    draw = np.random.default_rng([seed, list(RANGES).index(rig), effects, coloured])
    machine = _machine(rig, draw)
    names = draw.choice(sorted(RANGES[rig]), effects, replace=False).tolist()
    truth = {name: _smaller(_between(RANGES[rig][name], draw), draw) for name in names}
    declared: Effects = {}
    if rig != "driven" and "thread_friction" not in truth:
        declared = {"thread_friction": _between(THREADS, draw)}
    motion = MOTIONS[rig](draw)
    with_it, without = (_readings(rig, machine, each, motion) for each in (declared | truth, declared))
    shift = max(float(np.sqrt(np.mean((with_it[c] - without[c]) ** 2))) / s for c, s in NOISE[rig].items())
    columns = {**motion, **with_it}
    for name, size in NOISE[rig].items():
        columns[name] = columns[name] + size * noise(len(columns[name]), STEPS[rig], coloured, draw)
    card = _card(rig, machine, declared, draw)
    columns = {name: columns[name] for name in card.columns if name in columns}
    recording = Recording(f"{rig}-{seed}", None, None, card, _clock(rig), STEPS[rig], columns)
    return Blind(recording, truth, "coloured" if coloured else "white", shift)


def _between(ranges: Mapping[str, tuple[float, float]], draw: np.random.Generator) -> dict[str, float]:
    return {name: float(draw.uniform(*limits)) for name, limits in ranges.items()}


def _smaller(values: dict[str, float], draw: np.random.Generator) -> dict[str, float]:
    share = float(np.exp(draw.uniform(np.log(SMALLEST), 0.0)))
    return {name: share * value if name in SIZES else value for name, value in values.items()}


def _machine(rig: str, draw: np.random.Generator) -> dict[str, float]:
    """True constants of a machine, SI."""
    muscle = {
        "initial_length": draw.uniform(0.25, 0.36), "initial_radius": draw.uniform(6e-3, 9e-3),
        "braid_angle": np.deg2rad(draw.uniform(19, 24)), "end_factor": draw.uniform(1.2, 1.38),
        "ambient_pressure": AMBIENT,
    }  # fmt: skip
    own: dict[str, float] = {}
    if rig == "isotonic":
        own = {"valve_area": draw.uniform(1.2e-6, 2.2e-6), "valve_time_constant": draw.uniform(5e-3, 9e-3),
               "full_command": 5.0, "supply_pressure": AMBIENT + 6e5, "gas_temperature": 293.15,
               "polytropic_exponent": draw.choice([1.0, 1.2]), "mass": draw.uniform(6, 14)}  # fmt: skip
    if rig == "joint":
        own = {"regulator_frequency": draw.uniform(9, 14), "regulator_damping": draw.uniform(0.7, 1.0),
               "sprocket_radius": 0.015, "initial_contraction": draw.uniform(0.1, 0.18),
               "inertia": draw.uniform(0.04, 0.15)}  # fmt: skip
    return {name: float(value) for name, value in {**muscle, **own}.items()}


def _steps(draw: np.random.Generator, seconds: float, step: float, shortest: float, longest: float) -> Series:
    """Levels between -1 and 1, each held for a time between the two."""
    levels: list[float] = []
    while len(levels) < round(seconds / step):
        levels += [float(draw.uniform(-1, 1))] * round(draw.uniform(shortest, longest) / step)
    return np.array(levels[: round(seconds / step)])


def _sines(draw: np.random.Generator, t: Series, slowest: float, fastest: float) -> tuple[Series, Series]:
    """Sum of four sines between -1 and 1, and its rate."""
    size, frequency, phase = (
        draw.uniform(0.3, 1, 4),
        np.geomspace(slowest, fastest, 4),
        draw.uniform(0, 6.28, 4),
    )
    frequency, size = 2 * np.pi * frequency * draw.uniform(0.85, 1.15, 4), size / size.sum()
    angle = frequency * t[:, None] + phase
    return np.sin(angle) @ size, np.cos(angle) @ (size * frequency)


def _clock(rig: str) -> Series:
    return np.arange(round(SECONDS[rig] / STEPS[rig]), dtype=np.float64) * STEPS[rig]


def _imposed(draw: np.random.Generator) -> dict[str, Series]:
    t = _clock("driven")
    position, velocity = _sines(draw, t, 0.2, 1.8)
    pressure, _ = _sines(draw, t, 0.05, 0.5)
    return {"pressure": AMBIENT + 2.3e5 + 1.9e5 * pressure, "position": 0.028 + 0.024 * position,
            "velocity": 0.024 * velocity}  # fmt: skip


CYCLE = 4.0
"""Seconds from a lift to the next."""


def _commanded(draw: np.random.Generator) -> dict[str, Series]:
    """Lift, play about a level, let down; again and again."""
    t, step, seconds = _clock("isotonic"), STEPS["isotonic"], SECONDS["isotonic"]
    phase, block = t % CYCLE, (t // CYCLE).astype(int)
    play = 1.5 * _steps(draw, seconds, step, 0.1, 0.6) + 1.5 * _sines(draw, t, 0.5, 5)[0]
    plays = (phase > 0.3) & (phase < 2.6)
    for each in np.unique(block):  # what comes in goes out again: the pressure stays in the middle
        here = plays & (block == each)
        play[here] -= play[here].mean() + draw.uniform(-0.1, 0.3)
    command = np.select([phase <= 0.3, plays, phase < 3.6], [draw.uniform(2, 4.5), play, -5.0], 0.0)
    return {"command": np.clip(command, -5, 5)}


def _regulated(draw: np.random.Generator) -> dict[str, Series]:
    t, step, seconds = _clock("joint"), STEPS["joint"], SECONDS["joint"]
    difference = 0.6e5 * _steps(draw, seconds, step, 0.4, 1.6) + 0.6e5 * _sines(draw, t, 0.2, 2.0)[0]
    common = AMBIENT + 2.2e5 + 4e4 * _steps(draw, seconds, step, 2, 5)
    difference[: round(0.1 / step)] = 0.0
    return {"command_1": common + difference, "command_2": common - difference}


MOTIONS = {"driven": _imposed, "isotonic": _commanded, "joint": _regulated}


def _readings(
    rig: str, machine: Mapping[str, float], effects: Effects, motion: Mapping[str, Series]
) -> dict[str, Series]:
    """What the oracle gives for the sensors."""
    if rig == "driven":
        force = driven(machine, effects, motion["pressure"], motion["position"], motion["velocity"])
        return {"force": force}
    if rig == "isotonic":
        found = isotonic(machine, effects, motion["command"], STEPS[rig], AMBIENT, SUBSTEPS[rig])
        return {"pressure": found[0], "position": found[1]}
    commands = np.stack([motion["command_1"], motion["command_2"]], axis=1)
    found = joint(machine, effects, commands, STEPS[rig], tuple(commands[0]), 0.0, SUBSTEPS[rig])
    return {"pressure_1": found[0], "pressure_2": found[1], "angle": found[2]}


def noise(rows: int, step: float, coloured: bool, draw: np.random.Generator) -> Series:
    """Of unit size where white; coloured is as much again, an autoregression of first order."""
    white = draw.normal(size=rows)
    if not coloured:
        return white
    keep = np.exp(-step / draw.uniform(0.1, 2.0))
    slow, pushes = np.zeros(rows), draw.normal(size=rows) * np.sqrt(1 - keep**2)
    slow[0] = draw.normal()
    for row in range(1, rows):
        slow[row] = keep * slow[row - 1] + pushes[row]
    return white + slow


def _card(rig: str, machine: Mapping[str, float], declared: Effects, draw: np.random.Generator) -> Card:
    """As an experimenter would write it: what is uncertain is off by its standard deviation, normally."""
    absolute = {"unit": "Pa", "reference": "absolute"}

    def section(values: Mapping[str, float], stds: Mapping[str, float]) -> dict[str, Any]:
        found = {}
        for name, value in values.items():
            std = stds.get(name)
            off = 0.0 if std is None else float(np.clip(draw.normal(), -2, 2)) * std
            unit = absolute if name == "supply_pressure" else {"unit": UNITS.get(name, "")}
            found[name] = {"value": value + off, **unit, **({} if std is None else {"std": std})}
        return found

    stds = UNCERTAIN[rig]
    units = {"position": "m", "force": "N", "angle": "rad", "command": "V", "time": "s"}
    names = ["time", *_columns(rig)]
    columns = {n: {"column": n, **({"unit": units[n]} if n in units else absolute)} for n in names}
    skipped = {"ambient_pressure"} if rig != "isotonic" else set()
    known = {n: v for n, v in machine.items() if n not in stds and n not in skipped}
    return Card.parse(
        {
            "rig": rig,
            "columns": columns,
            "known": section(known, {}),
            "uncertain": section({n: machine[n] for n in stds}, stds),
            "noise": {n: {"value": size, "unit": units.get(n, "Pa")} for n, size in NOISE[rig].items()},
            "effects": {name: section(values, THREAD_STDS) for name, values in declared.items()},
            **({} if rig == "driven" else {"fit": {"horizon": {"value": 1, "unit": "s"}}}),
        }
    )


def _columns(rig: str) -> list[str]:
    if rig == "driven":
        return ["pressure", "position", "force"]
    if rig == "isotonic":
        return ["command", "pressure", "position"]
    return ["command_1", "command_2", "pressure_1", "pressure_2", "angle"]
