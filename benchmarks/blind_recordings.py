"""Fresh random recordings whose truth is drawn: machine, card, motion, what the card does not say, noise.

Readings come from the one-page oracles of the tests, which share no code with the models.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence, Set
from functools import cached_property
from pathlib import Path

import numpy as np
from blind_cards import NOISE, card_of, off_by, stds_of
from blind_ranges import BRISTLES, RANGES, ROUGH_SHARE, Effects, declared_of, offered, truth_of
from blind_shift import shift_left
from numpy.typing import NDArray

from jaxmuscle.recordings.recording import Recording

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles.driven import driven  # pyright: ignore[reportMissingImports]
from oracles.isotonic import isotonic  # pyright: ignore[reportMissingImports]
from oracles.jetpipe import jet_pipe  # pyright: ignore[reportMissingImports]
from oracles.joint import joint  # pyright: ignore[reportMissingImports]
from oracles.sensors import readings  # pyright: ignore[reportMissingImports]

AMBIENT = 101325.0
Series = NDArray[np.float64]
STEPS = {"driven": 0.01, "isotonic": 2e-3, "joint": 2e-3, "jet-pipe": 2e-3}
SECONDS = {"driven": 60.0, "isotonic": 20.0, "joint": 20.0, "jet-pipe": 5.0}
SUBSTEPS = {"isotonic": 6, "joint": 6, "jet-pipe": 16}


@dataclasses.dataclass(frozen=True)
class Blind:
    """A recording and its truth.

    Attributes:
        truth: effects that are there and not on the card, with their parameters; an error of a sensor says
            of which "column".
        noise: "white", or "coloured": as much again, correlated over a tenth of a second to two.
        bristles: the distance over which dry friction builds up, 0 on a bench of sharp friction.
        machine: true constants (SI).
        effects: all that are there, declared or not.
        measure: gives what :attr:`shift` and :attr:`left` are of each true effect; ten simulations more.
    """

    recording: Recording
    truth: Effects
    noise: str
    bristles: float
    machine: Mapping[str, float]
    effects: Effects
    measure: Callable[[], Sequence[tuple[float, float]]]

    @cached_property
    def _shifts(self) -> Sequence[tuple[float, float]]:
        return self.measure()

    @property
    def shift(self) -> float:
        """What a reading differs by from one without an effect, root mean square over its noise; the largest
        of all readings and effects. Where a recorded column is imposed, without the effect but as recorded.
        """
        return max((whole for whole, _ in self._shifts), default=0.0)

    @property
    def left(self) -> float:
        """The same of the effect that shows least, after the card's uncertain parameters and those of the
        other effect have taken over what they can.
        """
        return min((own for _, own in self._shifts), default=0.0)

    @property
    def most(self) -> float:
        """:attr:`left` of the effect that shows most."""
        return max((own for _, own in self._shifts), default=0.0)


def drawn(seed: int, rig: str, effects: int, coloured: bool, names: Sequence[str] = ()) -> Blind:
    """The recording of a seed, which lacks so many effects; of these names only, where there are any."""
    draw = np.random.default_rng([seed, list(RANGES).index(rig), effects, coloured])
    machine = machine_of(rig, draw)
    choice = offered(rig, names)
    truth = truth_of(rig, draw.choice(choice, min(effects, len(choice)), replace=False).tolist(), draw)
    declared = declared_of(rig, truth, draw)
    bristles = _bristles(rig, {*declared, *truth}, draw)
    bench = declared | ({"presliding": {"distance": bristles}} if bristles else {})
    if "gas_heating" in truth:
        machine["polytropic_exponent"] = 1.0  # the share is counted from the isothermal law
    motion = MOTIONS[rig](draw)
    exact, stds = readings_of(rig, machine, bench | truth, motion), stds_of(rig, declared)
    columns = {**exact}
    for name, size in NOISE[rig].items():
        columns[name] = exact[name] + size * noise(len(exact[name]), STEPS[rig], coloured, draw)
    card = card_of(rig, machine, declared, draw)
    columns = {name: columns[name] for name in card.columns if name in columns}
    recording = Recording(f"{rig}-{seed}", None, None, card, _clock(rig), STEPS[rig], columns)

    def measure() -> list[tuple[float, float]]:
        return [shift_of(name, rig, machine, bench, truth, stds, motion, exact) for name in truth]

    kind = "coloured" if coloured else "white"
    return Blind(recording, truth, kind, bristles, machine, bench | truth, measure)


def shift_of(
    name: str,
    rig: str,
    machine: Mapping[str, float],
    bench: Effects,
    truth: Effects,
    stds: Mapping[str, float],
    motion: Mapping[str, Series],
    columns: Mapping[str, Series],
) -> tuple[float, float]:
    """By how much one of the true effects moves the readings, and by how much of its own."""
    others = {other: values for other, values in truth.items() if other != name}
    free = {f"{e}.{n}": abs(v) for e, of in others.items() for n, v in of.items() if n != "column" and v}
    stds = {**stds, **free}

    def shown(effects: Effects) -> dict[str, Series]:
        """The motion as it is recorded; only what is imposed has a sensor."""
        seen = readings_of(rig, machine, bench | effects, motion) if motion.keys() & columns.keys() else {}
        return {each: seen.get(each, series) for each, series in motion.items()}

    own, beside = shown({name: truth[name]}), shown(others)

    def without(off: Mapping[str, float]) -> dict[str, Series]:
        constants, moved = off_by(machine, bench | others, stds, off)
        # An error of a sensor that is taken for another one leaves another motion as the true one.
        errors = shown({other: moved[other] for other in others}) if free.keys() & off.keys() else beside
        return readings_of(rig, constants, moved, {n: own[n] + beside[n] - errors[n] for n in own})

    return shift_left(without, list(stds), columns, NOISE[rig])


def _bristles(rig: str, effects: Set[str], draw: np.random.Generator) -> float:
    """Of a rough bench, 0 of another and of one without dry friction."""
    rough, distance = draw.random() < ROUGH_SHARE, np.exp(draw.uniform(*np.log(BRISTLES.get(rig, (1, 1)))))
    dry = effects & {"thread_friction", "load_friction"} and "presliding" not in effects
    return float(distance) if rough and dry else 0.0


def machine_of(rig: str, draw: np.random.Generator) -> dict[str, float]:
    """True constants of a machine, SI."""
    if rig == "jet-pipe":
        return _valve(draw)
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


def _valve(draw: np.random.Generator) -> dict[str, float]:
    """True constants of a jet-pipe valve on a cylinder that is held."""
    return {
        "ambient_pressure": AMBIENT, "gas_temperature": 293.15, "polytropic_exponent": 1.4,
        "supply_pressure": AMBIENT + draw.uniform(5e5, 6e5), "stopper_position": draw.uniform(0.043, 0.053),
        "current_gain": 0.1, "residual_force": 3.0, "pipe_compliance": draw.uniform(0.7e-3, 0.9e-3),
        "pipe_saturation_force": 0.9, "receiver_offset": draw.uniform(0.08e-3, 0.12e-3),
        "discharge_coefficient": draw.uniform(0.6, 0.75), "initial_pressure": 3e5,
    }  # fmt: skip


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


def _held(draw: np.random.Generator) -> dict[str, Series]:
    t, step, seconds = _clock("jet-pipe"), STEPS["jet-pipe"], SECONDS["jet-pipe"]
    level = 0.5 * _steps(draw, seconds, step, 0.2, 0.8) + 0.6 * _sines(draw, t, 0.4, 12)[0]
    return {"command": draw.uniform(0.6, 0.9) + level}


MOTIONS = {"driven": _imposed, "isotonic": _commanded, "joint": _regulated, "jet-pipe": _held}


def readings_of(
    rig: str, machine: Mapping[str, float], effects: Effects, motion: Mapping[str, Series]
) -> dict[str, Series]:
    """What the sensors say of what the oracle gives, and of the motion."""
    true = {name: series for name, series in motion.items() if name != "velocity"} | _true(
        rig, machine, effects, motion
    )
    return readings(effects, true, STEPS[rig])


def _true(
    rig: str, machine: Mapping[str, float], effects: Effects, motion: Mapping[str, Series]
) -> dict[str, Series]:
    """What the oracle gives."""
    step, substeps = STEPS[rig], SUBSTEPS.get(rig, 1)
    if rig == "driven":
        imposed = (motion[name] for name in ("pressure", "position", "velocity"))
        return {"force": driven(machine, effects, *imposed, step)}
    if rig == "isotonic":
        pressure, position, _ = isotonic(machine, effects, motion["command"], step, AMBIENT, substeps)
        return {"pressure": pressure, "position": position}
    if rig == "jet-pipe":
        if "current_saturation" in effects:
            limit = 1 / effects["current_saturation"]["inverse_limit"]
            effects = effects | {"current_saturation": {"limit": limit}}
        current, force = jet_pipe(machine, effects, motion["command"], step, substeps)
        return {"current": current, "force": force}
    commands = np.stack([motion["command_1"], motion["command_2"]], axis=1)
    first, second, angle, _ = joint(machine, effects, commands, step, tuple(commands[0]), 0.0, substeps)
    return {"pressure_1": first, "pressure_2": second, "angle": angle}


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
