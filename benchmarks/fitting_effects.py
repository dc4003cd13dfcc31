"""The own parameters of every effect, fitted from starts 30 to 50 % off: weights, thresholds, delays, limits.

Each on a rig that offers it, on a recording of the one-page oracles of the tests; creep, which they lack, by
its closed form in plain NumPy. Everything else about the machine is known.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from fitting_cases import CASES, Columns
from numpy.typing import NDArray
from oracles import bench  # pyright: ignore[reportMissingImports]
from oracles.driven import driven, lagged  # pyright: ignore[reportMissingImports]
from oracles.isotonic import isotonic  # pyright: ignore[reportMissingImports]
from oracles.jetpipe import jet_pipe  # pyright: ignore[reportMissingImports]
from oracles.joint import joint  # pyright: ignore[reportMissingImports]
from oracles.recorded import smooth_motion  # pyright: ignore[reportMissingImports]

import jaxmuscle as jm
from jaxmuscle.effects import CATALOGUE

OFF = (0.5, 1.4, 0.7)
"""What the true values are multiplied by to begin with, one after the other."""
SEEN = {"current_saturation": (1.5,)}
"""The same where half of the truth would not show in the data: a limit beyond every current."""
FOUND = 4.0
"""Distance from the truth in standard deviations up to which a parameter counts as found."""
KNOWN = 0.5
"""Standard deviation relative to the truth up to which it does."""

Values = dict[str, float]


@dataclasses.dataclass(frozen=True)
class Kind:
    """An effect on a rig. Attributes: its true values; what the oracle calls them, where that differs."""

    rig: str
    true: Values
    oracle: Callable[[Values], Values] = dict
    seconds: float = 8.0


KINDS = {
    "command_delay": Kind("isotonic", {"delay": 0.0135}),
    "current_saturation": Kind(
        "jet-pipe", {"inverse_limit": 1 / 0.15}, lambda v: {"limit": 1 / v["inverse_limit"]}
    ),
    "valve_hysteresis": Kind("jet-pipe", {"weight": 0.3, "width": 0.15}),
    "chamber_leak": Kind("isotonic", {"area": 1.5e-7}),
    "thread_friction": Kind("driven", bench.THREADS),
    "length_hysteresis": Kind("driven", bench.LOOP),
    "creep": Kind("driven", {"stiffness": 500.0, "fast_time": 0.5, "slow_time": 4.0}, seconds=20.0),
    "bladder_stiffness": Kind("driven", bench.BLADDER),
    "bladder_hoop_stiffness": Kind("driven", bench.WALL),
    "pressure_dependent_ends": Kind("driven", bench.ENDS),
    "muscle_mismatch": Kind("joint", {"ratio": 0.06}),
    "load_friction": Kind("joint", {"force": 0.4}),
    "load_damping": Kind("isotonic", {"coefficient": 150.0}),
    "gravity": Kind("joint", {"torque": 0.8, "hanging_angle": 0.6}),
    "force_sensor_lag": Kind("driven", {"time_constant": 0.04}),
}


def clean(name: str) -> Columns:
    """Readings of the oracle with this one effect."""
    kind = KINDS[name]
    effects = {name: kind.oracle(kind.true)}
    card, step = bench.CARDS[kind.rig], bench.STEPS[kind.rig]
    if kind.rig == "driven":
        return _driven(name, kind, card, step)
    if kind.rig == "isotonic":
        command = bench.isotonic_command()
        pressure, position, _ = isotonic(card, effects, command, step, bench.AMBIENT, 20)
        return {"command": command, "pressure": pressure, "position": position}
    if kind.rig == "joint":
        command = bench.joint_command()
        one, other, angle, _ = joint(card, effects, command, step, command[0], 0.0, 8)
        pairs = {f"command_{i + 1}": command[:, i] for i in (0, 1)}
        return {**pairs, "pressure_1": one, "pressure_2": other, "angle": angle}
    command = bench.jet_pipe_command()
    current, force = jet_pipe(card, effects, command, step, 20)
    return {"command": command, "current": current, "force": force}


def _driven(name: str, kind: Kind, card: Values, step: float) -> Columns:
    motion = smooth_motion(kind.seconds)
    force = driven(card, {name: kind.true}, *motion)
    if name == "creep":
        force = force - _crept(motion[1] / card["initial_length"], kind.true, step)
    if name == "force_sensor_lag":
        force = lagged(force, step, kind.true["time_constant"], 20)
    return {"pressure": motion[0], "position": motion[1], "force": force}


def _crept(strain: NDArray[np.float64], true: Values, step: float) -> NDArray[np.float64]:
    """K (z1 + z2)/2 with z' = (ε - z)/τ from rest, exact for a strain that is linear between its samples."""
    total = np.zeros(len(strain))
    for tau in (true["fast_time"], true["slow_time"]):
        z, way = strain[0], [strain[0]]
        for now, then in pairwise(strain):
            slope = (then - now) / step
            z = then - tau * slope + (z - now + tau * slope) * np.exp(-step / tau)
            way.append(z)
        total += np.array(way)
    return true["stiffness"] / 2 * total


def fitted(name: str, starts: int = 1) -> tuple[jm.FitResult, Values]:
    """The fit of one effect's own parameters, and the truth by the names of its parameters."""
    kind, rng = KINDS[name], np.random.default_rng(5)
    case, columns = CASES[kind.rig], clean(name)
    for column, level in case.noise.items():
        columns[column] = columns[column] + level * rng.normal(size=len(columns[column]))
    start = {
        key: value * off for (key, value), off in zip(kind.true.items(), SEEN.get(name, OFF), strict=False)
    }
    machine = bench.model(kind.rig, **{name: start})
    step = bench.STEPS[kind.rig]
    recorded = jm.recording(machine, columns, step, noise=case.noise, horizon=case.horizon, name=name)
    result = jm.fit(machine, recorded, [f"{name}.{key}" for key in kind.true], starts=starts)
    return result, {f"effects.{name}.{key}": value for key, value in kind.true.items()}


def row(name: str) -> dict[str, Any]:
    """How far the parameter that is farthest off is from the truth, in standard deviations."""
    begin = time.perf_counter()
    result, true = fitted(name)
    table = {
        key: {"true": value, "start": found.start, "found": found.value, "std": found.std}
        for key, value in true.items()
        for found in (result.parameters[key],)
    }
    off = max(abs(e["found"] - e["true"]) / e["std"] if e["std"] > 0 else np.inf for e in table.values())
    known = all(e["std"] <= KNOWN * abs(e["true"]) for e in table.values())
    listed = "; ".join(f"{key.split('.')[-1]} true {e['true']:.4g}, from {e['start']:.4g}, "
                       f"found {e['found']:.4g} ± {e['std']:.2g}" for key, e in table.items())  # fmt: skip
    return {"figure": f"{name} on {KINDS[name].rig}: parameters off by, in std", "goal": f"<= {FOUND:g}",
            "ours": off, "ok": bool(off <= FOUND and known), "parameters": table, "code": result.code,
            "told": listed, "why": f"{result.code}; {'; '.join(result.notes())}",
            "elapsed": time.perf_counter() - begin}  # fmt: skip


def every() -> Iterator[dict[str, Any]]:
    """A row for every effect of the catalogue."""
    for effect in CATALOGUE:
        found = row(effect.name)
        yield {key: value for key, value in found.items() if key != "why" or not found["ok"]}
