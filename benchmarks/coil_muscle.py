"""A rig that is not in the package: a coiled polymer muscle under a dead weight, and its measured cycles.

The muscles are those of Higueras-Ruiz, Shafer and Feigenbaum, "Cavatappi artificial muscles from drawing,
twisting, and coiling polymer tubes", Science Robotics 2021. They are no braided muscles: they creep under
constant pressure.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array
from scipy.signal import lfilter

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractActuator, Held, Link, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals

FOLDER = "cavatappi_fluidic_muscle"
AMBIENT, PSI, STEP = 101325.0, 6894.757, 0.1
NOISE = 5e-6
"""Standard deviation of the vibrometer's reading where nothing moves, m."""
TIMES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Time constants of the black box, s: from a few samples to a third of the longest cycle."""


@register
class CoilMuscle(AbstractActuator):
    """c x' = A P - k (x - x0): elasticity and drag of the wall, no mass. The pressure is imposed."""

    rig: ClassVar = "coil-muscle"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {
        name: name
        for name in ("area", "elasticity", "drag", "rest_position", "initial_length", "ambient_pressure")
    }
    commands: ClassVar = ()
    measured: ClassVar = {"pressure": ("pressure",), "position": ("position",)}
    derivatives: ClassVar = {}
    imposed: ClassVar = ("pressure",)
    outputs: ClassVar = {"position": ("position",)}
    links: ClassVar = (Link("position", ("pressure",), "muscle_force"),)
    available: ClassVar = frozenset("time pressure position contraction_ratio muscle_force".split())
    largest_step: ClassVar = 0.05

    area: Scalar = parameter("m^2", "force over pressure", positive=True)
    elasticity: Scalar = parameter("N/m", "elastic force over contraction", positive=True)
    drag: Scalar = parameter("N s/m", "drag over velocity", positive=True)
    rest_position: Scalar = parameter("m", "contraction without pressure", default=0.0, typical=1e-3)
    initial_length: Scalar = parameter("m", "length without pressure", default=0.1, positive=True)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=AMBIENT, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        return dict(measured)

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return jnp.zeros(())

    def signals(self, state: State, held: Held) -> Signals:
        signals = Signals(
            time=held.time,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            position=state["position"],
            contraction_ratio=state["position"] / self.initial_length,
        )
        elastic = self.elasticity * (state["position"] - self.rest_position)
        force = self.area * signals.gauge_pressure - elastic
        return self._with(signals, MUSCLE_FORCE, force, {**state.get("effects", {}), **held.memory})

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        rates = state_rates(self.effects, state.get("effects", {}), signals)
        velocity = signals.muscle_force / self.drag
        return {"pressure": jnp.zeros_like(state["pressure"]), "position": velocity, "effects": rates}

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"position": signals.position}

    def constrained(self, state: State) -> State:
        return state


def cycle(root: Path, name: str, machine: CoilMuscle) -> jm.Recording:
    """A recorded cycle, such as "400 grams LONG CYCLE", at 10 Hz: means of the samples in between."""
    table = pd.read_excel(root / FOLDER / f"Sample 3 Final {name}.xlsx").to_numpy(float)
    time, pressure, position = table[:, 2], table[:, 3] * PSI + AMBIENT, -1e-3 * table[:, 4]
    every = max(1, round(STEP / float(np.median(np.diff(time)))))
    rows = len(time) // every * every
    columns = {
        name: values[:rows].reshape(-1, every).mean(axis=1)
        for name, values in (("pressure", pressure), ("position", position))
    }
    return jm.recording(machine, columns, STEP, noise={"position": NOISE}, name=name.replace(" ", "-"))


def linear(train: list[jm.Recording], test: jm.Recording) -> np.ndarray:
    """Errors of x = Σ b_i (P filtered with a time constant) + c, fitted to training runs as a whole [m].

    An output-error model that is linear in its parameters: its time constants are given (:data:`TIMES`).
    """

    def regressors(run: jm.Recording) -> np.ndarray:
        gauge: Any = run.columns["pressure"] - AMBIENT
        poles = [np.exp(-STEP / each) for each in TIMES]
        filtered = [lfilter([1 - pole], [1, -pole], gauge) for pole in poles]
        return np.column_stack([np.ones(len(gauge)), gauge, *filtered])

    table = np.concatenate([regressors(run) for run in train])
    measured = np.concatenate([run.columns["position"] for run in train])
    size = np.abs(table).max(axis=0)
    weights = np.linalg.lstsq(table / size, measured, rcond=None)[0]
    return regressors(test) / size @ weights - test.columns["position"]
