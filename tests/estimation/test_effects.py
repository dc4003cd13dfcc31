"""Own parameters of effects from starts 30 to 50 % off; all: `benchmarks/fitting.py --only effects`."""

import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven, lagged
from oracles.recorded import NOISE, smooth_motion

import jaxmuscle as jm

STEP = bench.STEPS["driven"]
TRUE = {"force_sensor_lag": {"time_constant": 0.04}, "length_hysteresis": bench.LOOP}
START = {
    "force_sensor_lag": {"time_constant": 0.02},
    "length_hysteresis": {"weight": 0.065, "asymmetry": -0.14, "density_width": 0.07},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUE)
def test_a_lag_and_the_weights_of_plays_are_found(name):
    motion = smooth_motion(6.0)
    force = driven(bench.CARDS["driven"], {name: TRUE[name]}, *motion)
    if name == "force_sensor_lag":
        force = lagged(force, STEP, TRUE[name]["time_constant"], 20)
    force = force + NOISE * np.random.default_rng(1).normal(size=len(force))
    columns = {"pressure": motion[0], "position": motion[1], "force": force}
    machine = bench.model("driven", **{name: START[name]})
    recording = jm.recording(machine, columns, STEP, noise={"force": NOISE}, name=name)
    fit = jm.fit(machine, recording, [f"{name}.{key}" for key in TRUE[name]])
    assert fit.converged
    for key, true in TRUE[name].items():
        found = fit.parameters[f"effects.{name}.{key}"]
        assert abs(found.value - true) < 4 * found.std, key
        assert found.std < 0.4 * abs(true), key
