"""Errors of sensors beside everything else that a machine may lack."""

import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.effects import CATALOGUE, reading_effects

NOISE = {"pressure": 300.0, "position": 5e-5}


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
    found = jm.diagnose(recording, catalogue=(*CATALOGUE, *reading_effects(machine)))
    assert found.verdict == "effects found"
    assert found.effects[0].name.startswith("sensor_offset")
    offset = found.effects[0].parameters["offset"]
    assert abs(offset.value - 3e3) < 3 * offset.std and offset.std < 300 and offset.unit == "Pa"
    assert len(found.effects) == 1
    assert all(error.in_noise < 1.3 for error in found.after["held_out"].values())
