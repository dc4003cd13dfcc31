"""Strengths of effects from a simulated recording with noise, found by a fit from starts far off."""

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import NOISE, smooth_motion

import jaxmuscle as jm

FRICTION = {"load_friction": {"force": 0.8}}
PULLED = {
    "wall_thickness": ({"thickness": 6e-4}, {}, 0.0),
    "force_drift": ({"share": 0.08, "time_constant": 9.0}, {}, 0.0),
    "elastic_tendon": ({"compliance": 5e-6}, {}, 0.0),
    "bouc_wen": ({"amplitude": 12.0, "distance": 3e-3}, {}, 0.0),
    "presliding": ({"distance": 1.5e-3}, {"thread_friction": bench.THREADS}, 6e-4),
}
TURNED = {
    "eccentric_sprocket": ({"eccentricity": 0.05, "phase": 0.4}, {}, 0.0),
    "end_stop": ({"stiffness": 25.0, "position": 0.25, "damping": 0.2}, {}, 10.0),
    "stribeck": ({"excess": 0.6, "velocity_constant": 0.3}, FRICTION, 0.2),
    "pressure_dependent_friction": ({"coefficient": 1.5e-6}, FRICTION, 0.0),
    "presliding": ({"distance": 0.02}, FRICTION, 8e-3),
}
"""Effect → true values, other effects on both machines, strength from which the fit starts."""
JOINT_NOISE = {"pressure": 400.0, "angle": 1e-4}


def strength_of(name):
    return bench.BY_NAME[name].strength


def machines(rig, name, cases):
    """The true machine, and the one with the strength of the effect as a fit starts."""
    true, others, start = cases[name]
    off = {**true, strength_of(name): start}
    return bench.model(rig, **others, **{name: true}), bench.model(rig, **others, **{name: off})


def assert_found(machine, recording, name, true):
    strength = strength_of(name)
    fit = jm.fit(machine, recording, [f"{name}.{strength}"])
    found = fit.parameters[f"effects.{name}.{strength}"]
    assert fit.converged
    assert abs(found.value - true[strength]) < 4 * found.std
    assert found.std < 0.1 * abs(true[strength])


@pytest.mark.thorough
@pytest.mark.parametrize("name", PULLED)
def test_on_a_test_machine(name):
    truth, start = machines("driven", name, PULLED)
    motion = smooth_motion(6.0)
    force = np.asarray(bench.simulated(truth, bench.driven_track(*motion), 1).readings["force"])
    force = force + NOISE * np.random.default_rng(5).normal(size=len(force))
    columns = {"pressure": motion[0], "position": motion[1], "force": force}
    recording = jm.recording(start, columns, bench.STEPS["driven"], noise={"force": NOISE}, name=name)
    assert_found(start, recording, name, PULLED[name][0])


@pytest.mark.thorough
@pytest.mark.parametrize("name", TURNED)
def test_on_a_joint(name):
    truth, start = machines("joint", name, TURNED)
    command = bench.joint_command()
    readings = bench.simulated(truth, bench.joint_track(command), 4).readings
    rng = np.random.default_rng(6)
    columns = {f"command_{i + 1}": command[:, i] for i in range(2)}
    pressure = np.asarray(readings["pressure"])
    pressure = pressure + JOINT_NOISE["pressure"] * rng.normal(size=pressure.shape)
    columns |= {f"pressure_{i + 1}": pressure[:, i] for i in range(2)}
    angle = np.asarray(readings["angle"])
    columns["angle"] = angle + JOINT_NOISE["angle"] * rng.normal(size=len(angle))
    noise = {name: JOINT_NOISE[name.split("_")[0]] for name in columns if not name.startswith("command")}
    recording = jm.recording(start, columns, bench.STEPS["joint"], noise=noise, horizon=0.4, name=name)
    assert_found(start, recording, name, TURNED[name][0])
