"""Made-up outcomes of a diagnosis on a sample recording, one for each verdict."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pandas as pd
from scipy import signal

from jaxmuscle.diagnosis.diagnosis_data import (
    Alternative,
    Error,
    Estimate,
    FoundEffect,
    Reveal,
    Round,
    Traces,
    Unexplained,
)
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.effects import LoadFriction
from jaxmuscle.recordings import Recording, actuator_from_card, read
from jaxmuscle.samples import sample

CANDIDATES = (
    ("load_friction", "load", 0.93, 1e-12, 1.05, False),
    ("load_damping", "load", 0.71, 3e-7, 4.2, True),
    ("creep", "muscle_force", 0.38, 2e-3, 9.1, True),
    ("chamber_leak", "mass_flow", 0.02, 0.21, 14.4, True),
    ("command_delay", "command", -0.1, 0.8, 16.0, True),
)
PARAMETERS = {
    "valve_area": Estimate(1.1712e-6, 3.1e-9, "m^2", "effective area of the valve"),
    "valve_time_constant": Estimate(0.00721, 0.00012, "s", "time constant of the spool"),
    "end_factor": Estimate(1.291, 0.0042, "", "correction of the ends"),
    "effects.thread_friction.kinetic_coefficient": Estimate(
        0.0893, 0.0011, "", "kinetic friction coefficient"
    ),
    "effects.load_friction.force": Estimate(16.21, 0.38, "N", "Coulomb friction of the guide"),
}
FORCE = "effects.load_friction.force"
NO_FIT: Any = None
"""In place of the final fit, of which a report shows nothing but the values."""


@functools.cache
def recording() -> Recording:
    """The isotonic sample."""
    return read(sample("lift"))


@functools.cache
def diagnosis(verdict: str) -> Diagnosis:
    """An outcome with the given verdict."""
    found = verdict in ("effects found", "not confirmed")
    traces = _traces(verdict)
    model = actuator_from_card(recording().card)
    fitted = {name: e for name, e in PARAMETERS.items() if found or name != FORCE}
    friction: Any = LoadFriction
    ranking = tuple(Alternative(*candidate) for candidate in CANDIDATES)
    poor = tuple(dataclasses.replace(a, gain=0.01 * a.gain, p_value=0.4, told_apart=False) for a in ranking)
    searches = (Round(15.2, ranking, "load_friction"), Round(1.05, poor[1:], None))
    effect = FoundEffect(
        "load_friction",
        "load",
        "Coulomb friction of the load's guide or bearing.",
        "Coulomb, [H] 2.34",
        {"force": PARAMETERS[FORCE]},
        0.93,
        1e-12,
    )
    unexplained = {
        "effects found": (Unexplained("mass_flow", 0.12, ("pressure",), 1.3),),
        "complete": (),
        "undecided": (),
        "not confirmed": (),
        "unexplained": (Unexplained("load", 0.71, ("position", "velocity"), 41.0),),
    }
    return Diagnosis(
        recording=recording(),
        verdict=verdict,
        effects=(effect,) if verdict == "effects found" else (),
        unconfirmed=(effect,) if verdict == "not confirmed" else (),
        refused={"creep": "its strength is not sure"} if found else {},
        unused={"position": 12} if verdict == "not confirmed" else {},
        violated_priors={"end_factor": 4.2} if verdict == "not confirmed" else {},
        share_left=0.1 if found else 1.0,
        typical_error=1.1,
        missing_in_noise={"undecided": 2.3, "unexplained": 41.0}.get(verdict, 0.1),
        rounds=searches if found else (Round(1.02, poor, None),),
        declared=model,
        model=model.with_effects(load_friction=friction(force=16.21)) if found else model,
        fit=NO_FIT,
        before=_errors(traces, traces.before),
        after=_errors(traces, traces.after),
        noise={"pressure": 400.0, "position": 3e-5},
        units={"pressure": "Pa", "position": "m"},
        horizon=1.0,
        held_out_fraction=0.3,
        unexplained=unexplained[verdict],
        parameters=fitted,
        correlations=_correlations(list(fitted), 0.95 if found else 0.4),
        reveal=_reveal(verdict),
        traces=traces,
        converged=True,
        seconds=31.2,
        settings={"seed": 0, "folds": 5, "held_out_fraction": 0.3},
    )


def _traces(verdict: str) -> Traces:
    source, rng = recording(), np.random.default_rng(0)
    time, samples = source.time, len(source)
    windows = np.arange(0, samples - 1, 500)
    phase = (np.arange(samples) % 500) / 500
    lag = -np.tanh(_velocity() / 0.004) * 4e-3 * (1 - np.exp(-4 * phase))
    lacking = {"position": lag if verdict != "complete" else 0 * lag, "pressure": 2e6 * lag * phase / 10}
    if verdict == "complete":
        lacking["pressure"] = 0 * lag
    noise = {"position": 3e-5, "pressure": 400.0}
    measured = {column: source.columns[column] for column in noise}
    before = {c: measured[c] + lacking[c] + noise[c] * rng.standard_normal(samples) for c in noise}
    after = before
    if verdict == "effects found":
        after = {c: measured[c] + 0.01 * lacking[c] + noise[c] * rng.standard_normal(samples) for c in noise}
    held_out = np.arange(samples) >= int(0.7 * samples)
    return Traces(time, measured, before, after, windows, held_out)


def _velocity() -> np.ndarray:
    position, step = recording().columns["position"], recording().step
    return np.asarray(signal.savgol_filter(position, 151, 2, deriv=1, delta=step))


def _errors(traces: Traces, predicted: dict[str, np.ndarray]) -> dict[str, dict[str, Error]]:
    noise, units = {"position": 3e-5, "pressure": 400.0}, {"position": "m", "pressure": "Pa"}

    def error(column: str, rows: np.ndarray) -> Error:
        measured = traces.measured[column][rows]
        rmse = math.sqrt(np.mean((predicted[column][rows] - measured) ** 2))
        return Error(rmse, units[column], rmse / float(np.std(measured)), rmse / noise[column])

    parts = {"training": ~traces.held_out, "held_out": traces.held_out}
    return {part: {c: error(c, rows) for c in predicted} for part, rows in parts.items()}


def _correlations(names: list[str], strongest: float) -> pd.DataFrame:
    matrix = 0.2 * np.ones((len(names), len(names))) + 0.8 * np.eye(len(names))
    matrix[0, 1] = matrix[1, 0] = -strongest
    return pd.DataFrame(matrix, index=names, columns=names)


def _reveal(verdict: str) -> Reveal | None:
    if verdict == "complete":
        return None
    velocity, rng = _velocity(), np.random.default_rng(1)
    noise = 0.6 * rng.standard_normal((2, len(velocity)))
    before = -2.0 * np.tanh(velocity / 0.01) + noise[0]
    after = noise[1] if verdict == "effects found" else before
    return Reveal(
        "load_friction" if verdict == "effects found" else None,
        "load",
        "velocity",
        "m/s",
        "m/s^2",
        velocity,
        before,
        after,
    )
