"""A recording of every rig, made by the one-page NumPy oracles of the tests, and what is to be found in it.

No code is shared with the model. The clean readings are made once; a repeat is another draw of the noise.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.parameters import get

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles import bench  # pyright: ignore[reportMissingImports]
from oracles.driven import driven  # pyright: ignore[reportMissingImports]
from oracles.elbow import elbow  # pyright: ignore[reportMissingImports]
from oracles.isotonic import isotonic  # pyright: ignore[reportMissingImports]
from oracles.jetpipe import jet_pipe  # pyright: ignore[reportMissingImports]
from oracles.joint import joint  # pyright: ignore[reportMissingImports]
from oracles.piston import piston  # pyright: ignore[reportMissingImports]
from oracles.recorded import smooth_motion  # pyright: ignore[reportMissingImports]

Columns = dict[str, NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class Case:
    """One rig.

    Attributes:
        clean: the oracle's readings and what drives it.
        noise: column → standard deviation of its sensor; the other columns have none.
        free: what is fitted; the truth is what `machine` has.
        effects: those that the oracle has and the model declares.
        starts: of a fit for the coverage; dry friction that sticks and slips makes the cost rugged.
        draws: of the noise in a repeat of the coverage, more where a fit is quick: less is then chance.
        other: quantities whose true values are others than on the card of the tests.
        masked: column → spans of time [s] whose readings do not count.
    """

    rig: str
    clean: Callable[[], Columns]
    noise: dict[str, float]
    free: tuple[str, ...]
    effects: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    horizon: float | None = None
    starts: int = 1
    draws: int = 1
    other: dict[str, float] = dataclasses.field(default_factory=dict)
    masked: dict[str, tuple[tuple[float, float], ...]] = dataclasses.field(default_factory=dict)

    @property
    def machine(self) -> AbstractActuator:
        """The machine with the true values."""
        machine = bench.model(self.rig, **self.effects)
        return jm.replace(machine, {machine.quantities[name]: value for name, value in self.other.items()})

    def recording(self, seed: int) -> jm.Recording:
        """The readings with a draw of the noise."""
        rng, columns = np.random.default_rng([seed, 20]), dict(_clean(self.rig))
        for name, level in self.noise.items():
            columns[name] = columns[name] + level * rng.normal(size=len(columns[name]))
        step = bench.STEPS[self.rig]
        return jm.recording(
            self.machine, columns, step, noise=self.noise, horizon=self.horizon, name=self.rig
        )

    @property
    def masks(self) -> dict[str, NDArray[np.bool_]] | None:
        """Rows that do not count, as `jaxmuscle.fit` takes them."""
        if not self.masked:
            return None
        time = np.arange(len(_clean(self.rig)["command"])) * bench.STEPS[self.rig]
        return {
            column: np.any([(time >= begin) & (time < end) for begin, end in spans], axis=0)
            for column, spans in self.masked.items()
        }

    def truth(self) -> dict[str, float]:
        """Free parameter → true value."""
        machine = self.machine
        return {name: float(get(machine, name)) for name in self.free}


@functools.cache
def _clean(rig: str) -> Columns:
    return CASES[rig].clean()


THREADS = {"thread_friction": bench.THREADS}
DAMPING = {"load_damping": {"coefficient": 150.0}}
# With more stiction than Coulomb friction a creeping piston runs away at (F_s - F_c)/(m v_s), 3500 1/s: over
# a recording in one window derivatives grow by 10^10, and no standard deviation can be made from them.
EVEN = {"coulomb_friction": 0.8, "stiction": 0.8}
# The piston is thrown against the stopper twice. A bounce there is over within 1 ms, half a sampling step and
# four steps of the solver: its readings turn on where within a step it falls, by up to two standard
# deviations of the noise up and down as a parameter moves by a thousandth of its own, and where the piston
# sticks afterwards remembers it. The cost is rugged there and derivatives mean little; before and after it is
# smooth. The first span also holds the arrival of starts that are too slow.
IMPACTS = (0.06, 0.25), (0.88, 0.98)
BEARING = {"load_friction": {"force": 0.4}, "load_damping": {"coefficient": 0.05}}


def _driven() -> Columns:
    motion = smooth_motion(8.0)
    force = driven(bench.CARDS["driven"], THREADS, *motion)
    return {"pressure": motion[0], "position": motion[1], "force": force}


def _isotonic() -> Columns:
    command = bench.isotonic_command()
    card, step = bench.CARDS["isotonic"], bench.STEPS["isotonic"]
    pressure, position, _ = isotonic(card, DAMPING, command, step, bench.AMBIENT, 20)
    return {"command": command, "pressure": pressure, "position": position}


def _joint() -> Columns:
    command = bench.joint_command()
    card, step = bench.CARDS["joint"], bench.STEPS["joint"]
    first, second, angle, _ = joint(card, BEARING, command, step, command[0], 0.0, 8)
    pairs: Any = {"command_1": command[:, 0], "command_2": command[:, 1]}
    return {**pairs, "pressure_1": first, "pressure_2": second, "angle": angle}


def _elbow() -> Columns:
    command = bench.elbow_command()
    pressure, angle = elbow(bench.CARDS["elbow"], {}, command, bench.STEPS["elbow"], command[0], 100)
    return {"command": command, "pressure": pressure, "angle": angle}


def _jet_pipe() -> Columns:
    command = bench.jet_pipe_command()
    current, force = jet_pipe(bench.CARDS["jet-pipe"], {}, command, bench.STEPS["jet-pipe"], 20)
    return {"command": command, "current": current, "force": force}


def _piston_command() -> NDArray[np.float64]:
    """Out to the stopper, let go, pull hard, sines, off the stopper and back, small loops [V; Pa]; 1.2 s.

    Hard where the piston has a way to go, so that it arrives with parameters that are far off, too.
    """
    t = np.arange(600) * bench.STEPS["jet-pipe-piston"]
    sines = 0.9 + 0.8 * np.sin(2 * np.pi * 9 * (t - 0.5))
    loops = 0.6 + 0.25 * np.sin(2 * np.pi * 20 * (t - 1.0))
    spans = [t < 0.25, t < 0.35, t < 0.5, t < 0.8, t < 0.9, t < 1.0]
    volts = np.select(spans, [2.0, 0.3, 2.2, sines, -0.8, 2.0], loops)
    return np.stack([volts, bench.piston_command()[:, 1]], axis=1)


def _jet_pipe_piston() -> Columns:
    command, card = _piston_command(), {**bench.CARDS["jet-pipe-piston"], **EVEN}
    current, force, *_ = piston(card, command, bench.STEPS["jet-pipe-piston"], 100)
    return {"command": command[:, 0], "supply_pressure": command[:, 1], "current": current, "force": force}


CASES = {
    case.rig: case
    for case in (
        Case(
            "driven",
            _driven,
            {"force": 0.8},
            ("initial_radius", "end_factor", *(f"thread_friction.{name}" for name in bench.THREADS)),
            THREADS,
            draws=10,
        ),
        Case(
            "isotonic",
            _isotonic,
            {"pressure": 400.0, "position": 3e-5},
            ("valve_area", "valve_time_constant", "end_factor", "load_damping.coefficient"),
            DAMPING,
            horizon=0.5,
        ),
        Case(
            "joint",
            _joint,
            {"pressure_1": 400.0, "pressure_2": 400.0, "angle": 3e-4},
            ("regulator_frequency", "regulator_damping", "end_factor", "inertia", "load_friction.force"),
            BEARING,
            horizon=0.4,
            starts=6,
        ),
        Case(
            "elbow",
            _elbow,
            {"pressure": 400.0, "angle": 3e-3},
            ("regulator_frequency", "regulator_damping", "rising_height", "falling_height", "density"),
        ),
        Case(
            "jet-pipe",
            _jet_pipe,
            {"current": 1e-3, "force": 0.3},
            ("current_gain", "pipe_compliance", "receiver_offset", "discharge_coefficient"),
        ),
        Case(
            "jet-pipe-piston",
            _jet_pipe_piston,
            {"current": 1e-3, "force": 0.3},
            ("current_gain", "pipe_compliance", "receiver_offset", "discharge_coefficient"),
            other=EVEN,
            masked={"force": IMPACTS},
        ),
    )
}
