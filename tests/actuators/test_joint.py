"""Rig `joint` against its oracle and against the closed forms of [T]."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.friction import BRISTLE_TIME
from oracles.joint import joint

import jaxmuscle.effects.slip
from jaxmuscle.actuators import Held
from jaxmuscle.parameters import replace

SMOOTH = {
    "bare": {},
    "command_delay": {"command_delay": {"delay": 0.024}},
    "load_damping": {"load_damping": {"coefficient": 0.1}},
    "gravity": {"gravity": {"torque": 2.0, "hanging_angle": 0.7}},
    "muscle_mismatch": {"muscle_mismatch": {"ratio": -0.08}},
    "bladder_stiffness": {"bladder_stiffness": bench.BLADDER},
    "bladder_hoop_stiffness": {"bladder_hoop_stiffness": bench.WALL},
    "pressure_dependent_ends": {"pressure_dependent_ends": bench.ENDS},
    "length_hysteresis": {"length_hysteresis": bench.LOOP},
    "eccentric_in_line": {"eccentric_sprocket": {"eccentricity": 0.06, "phase": 0.5}},
    "eccentric_beside": {"eccentric_sprocket": {"eccentricity": 0.06, "phase": 0.5, "wrap_angle": 3.1}},
}
DRY = {
    "load_friction": {"load_friction": {"force": 0.8}},
    "thread_friction": {"thread_friction": bench.THREADS},
    "together": {
        "thread_friction": bench.THREADS,
        "load_friction": {"force": 0.3},
        "gravity": {"torque": 1.0, "hanging_angle": 0.3},
        "load_damping": {"coefficient": 0.02},
    },
}
CASES = {**SMOOTH, **DRY}
DAMPED = SMOOTH["load_damping"]
CARRIED = tuple(dict.fromkeys(effect for case in CASES.values() for effect in case))
COMMAND = bench.joint_command()
CARD = bench.CARDS["joint"]


@cache
def reference(name):
    substeps = 40 if name in DRY else 5
    return joint(CARD, CASES[name], COMMAND, bench.STEPS["joint"], COMMAND[0], 0.0, substeps)


def deviations(name, simulate=bench.simulated):
    *pressures, angle, velocity = reference(name)
    if name in DRY:
        assert (velocity[100:] == 0).sum() > 8 and np.abs(velocity).max() > 2
    actuator = bench.model("joint", CARRIED, **CASES[name])
    readings = simulate(actuator, bench.joint_track(COMMAND), 16).readings
    pressure = bench.deviation(readings["pressure"], np.transpose(pressures))
    return pressure, bench.deviation(readings["angle"], angle)


@pytest.mark.parametrize("name", SMOOTH)
def test_equals_oracle(name):
    # From 16 to 32 steps a sample the model moves by up to 1e-6 of the range, the oracle, from 5 to 10, by up
    # to 2e-6.
    pressure, angle = deviations(name)
    assert pressure < 5e-6
    assert angle < 5e-6


def test_a_muscle_goes_slack_in_the_comparison():
    angle = reference("bare")[2]
    slack = (1 - 1 / (np.sqrt(3) * np.cos(CARD["braid_angle"]))) / CARD["end_factor"]
    contraction = CARD["initial_contraction"] + CARD["sprocket_radius"] / CARD["initial_length"] * angle
    assert (contraction > slack).sum() > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", DRY)
def test_equals_oracle_with_dry_friction(name):
    # What a sticking time of 0.5 ms leaves: 0.13 % of the range of the angle.
    pressure, angle = deviations(name)
    assert pressure < 5e-6
    assert angle < 2e-3


@pytest.mark.slow
def test_threads_on_bristles_equal_the_oracle():
    """Friction of threads is several times that at rest in motion: bristles bend on, as in LuGre."""
    effects = {"thread_friction": bench.THREADS, "presliding": {"distance": 2e-3}}
    angle = joint(CARD, effects, COMMAND, bench.STEPS["joint"], COMMAND[0], 0.0, 40)[2]
    effects["presliding"]["damping_time"] = BRISTLE_TIME
    bent, sharp = (
        bench.simulated(machine, bench.joint_track(COMMAND), 16).readings["angle"]
        for machine in (bench.model("joint", **effects), bench.model("joint", **DRY["thread_friction"]))
    )
    assert bench.deviation(bent, angle) < 2e-3
    assert bench.deviation(sharp, angle) > 2e-2


@pytest.mark.slow
def test_dry_friction_approaches_the_sharp_law(monkeypatch):
    _, angle = deviations("load_friction")
    monkeypatch.setattr(jaxmuscle.effects.slip, "STICKING_TIME", 1e-4)
    jax.clear_caches()  # What was traced holds the constant as it was.
    _, sharper = deviations("load_friction")
    jax.clear_caches()
    assert sharper < angle / 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "path"),
    [
        ("end_factor", "muscle.end_factor"),
        ("inertia", "inertia"),
        ("regulator_frequency", "regulator.frequency"),
    ],
)
def test_sensitivity_equals_that_of_the_oracle(quantity, path):
    actuator, track = bench.model("joint", **DAMPED), bench.joint_track(COMMAND)

    @eqx.filter_jit
    def angle(value):
        return bench.simulate(replace(actuator, {path: value}), track, 8).readings["angle"]

    value, width = CARD[quantity], 1e-5 * CARD[quantity]
    slope = jax.jvp(angle, (jnp.asarray(value),), (jnp.asarray(1.0),))[1]
    higher, lower = (
        joint({**CARD, quantity: v}, DAMPED, COMMAND, bench.STEPS["joint"], COMMAND[0], 0.0, 10)[2]
        for v in (value + width, value - width)
    )
    assert bench.deviation(slope, (higher - lower) / (2 * width)) < 1e-4


def robot_joint():
    """Joint 1 of [T]: l0 = 31 cm, r0 = 0.7 cm, α0 = 23°, R = 1.5 cm, ε0 = 0.1, k = 1.25."""
    values = {
        "muscle.initial_length": 0.31,
        "muscle.braid_angle": np.deg2rad(23),
        "muscle.end_factor": 1.25,
        "initial_contraction": 0.1,
    }
    return replace(bench.model("joint"), values)


def torque(actuator, first, second, angle):
    pressure = bench.AMBIENT + jnp.array([first, second])
    state = {"pressure": pressure, "pressure_rate": jnp.zeros(2), "angle": jnp.asarray(angle)}
    state["angular_velocity"] = jnp.zeros(())
    return float(actuator.signals(state, Held(pressure, None, {})).load)


def gains(l0=0.31, r0=0.007, radius=0.015, k=1.25, e0=0.1):
    """K1, K2, K3 of the antagonist section of [T]."""
    alpha = np.deg2rad(23)
    a, b, area = 3 / np.tan(alpha) ** 2, 1 / np.sin(alpha) ** 2, np.pi * r0**2
    k1 = area * radius * (a * (1 - k * e0) ** 2 - b)
    k2 = area * radius * 2 * a * k * (1 - k * e0) * radius / l0
    return k1, k2, area * radius * a * k**2 * (radius / l0) ** 2


def test_largest_torque_of_the_robot():
    assert torque(robot_joint(), 5e5, 0.0, 0.0) == pytest.approx(7.15, abs=0.01)


@pytest.mark.parametrize("angle", [-0.9, 0.3, 1.1])
def test_torque_is_the_quadratic_of_the_antagonist_section(angle):
    k1, k2, k3 = gains()
    p1, p2 = 3.1e5, 2.2e5
    expected = k1 * (p1 - p2) - k2 * (p1 + p2) * angle + k3 * (p1 - p2) * angle**2
    assert torque(robot_joint(), p1, p2, angle) == pytest.approx(expected, rel=1e-12)


def test_slack_muscle_does_not_push():
    actuator = robot_joint()
    assert torque(actuator, 3e5, 2e5, 6.0) == torque(actuator, 1e5, 2e5, 6.0) < 0


def test_oscillates_at_the_frequency_of_its_natural_stiffness():
    actuator = robot_joint()
    pressure = np.full((1500, 2), bench.AMBIENT + 2.5e5)
    track = bench.track("joint", pressure, pressure=pressure, angle=0.01, angular_velocity=0.0)
    angle = bench.simulated(actuator, track, 4).readings["angle"]
    omega = np.sqrt(2 * gains()[1] * 2.5e5 / float(actuator.inertia))
    time = np.arange(1500) * 2e-3
    np.testing.assert_allclose(angle, 0.01 * np.cos(omega * time), atol=1e-6)
