"""Errors of sensors beside everything else that a machine may lack."""

from typing import Any

import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.diagnosis.prediction_errors import predicted_columns
from jaxmuscle.effects import (
    BladderStiffness,
    Creep,
    LengthHysteresis,
    PressureDependentEnds,
    reading_effect,
    reading_effects,
)
from jaxmuscle.estimation.case import case

NOISE = {"pressure": 300.0, "position": 5e-5}


@pytest.mark.slow
def test_predictions_of_a_column_that_is_read_late_begin_at_true_velocities():
    machine, step = bench.model("isotonic"), bench.STEPS["isotonic"]
    command = bench.isotonic_command()
    time = np.arange(len(command)) * step
    readings = jm.simulate(machine, command, time).readings
    rng = np.random.default_rng(1)
    late = {"pressure": readings["pressure"], "position": np.interp(time - 4e-3, time, readings["position"])}
    columns = {n: np.asarray(late[n]) + NOISE[n] * rng.normal(size=len(command)) for n in NOISE}
    recording = jm.recording(machine, {"command": command, **columns}, step, noise=NOISE, horizon=0.425)
    effect: Any = reading_effect("clock_offset", "position")
    predicted = predicted_columns(case(recording, 0.3), machine.with_effects(late=effect(delay=4e-3)))
    for name, series in predicted.items():
        inside = np.isfinite(series)
        assert np.std((series - columns[name])[inside]) < 1.3 * NOISE[name], name


@pytest.mark.slow
def test_an_offset_of_the_pressure_is_named_before_any_physics():
    """3 kPa too much in the pressure, which is a reading and the input of the force."""
    machine, step = bench.model("isotonic"), bench.STEPS["isotonic"]
    command = np.tile(bench.isotonic_command(), 4)
    readings = jm.simulate(machine, command, np.arange(len(command)) * step).readings
    rng = np.random.default_rng(1)
    columns = {n: np.asarray(readings[n]) + NOISE[n] * rng.normal(size=len(command)) for n in NOISE}
    columns |= {"command": command, "pressure": columns["pressure"] + 3e3}
    recording = jm.recording(machine, columns, step, noise=NOISE, horizon=0.425)
    # It was taken for a negative bladder stiffness, or for that and creep.
    physics = (BladderStiffness, Creep, LengthHysteresis, PressureDependentEnds)
    found = jm.diagnose(recording, catalogue=(*physics, *reading_effects(machine)))
    assert found.verdict == "effects found"
    assert found.effects[0].name.startswith("sensor_offset")
    offset = found.effects[0].parameters["offset"]
    assert abs(offset.value - 3e3) < 3 * offset.std and offset.std < 300 and offset.unit == "Pa"
    assert len(found.effects) == 1
    assert all(error.in_noise < 1.3 for error in found.after["held_out"].values())
