"""Strengths of effects between command and chamber, from a lift that was made with them."""

import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.parameters import get

STEP = bench.STEPS["isotonic"]
NOISE = {"pressure": 400.0, "position": 3e-5}
TRUE = {
    "dead_band": {"width": 0.3},
    "valve_offset": {"offset": -0.12},
    "valve_hysteresis": {"half_width": 0.2},
    "rate_limit": {"inverse_rate": 1 / 60},
    "line_lag": {"time_constant": 0.015},
    "supply_droop": {"resistance": 1.5e7},
    "dead_volume": {"volume": 1e-5},
    "gas_heating": {"share": 0.6},
}
BEGIN = {"rate_limit": {"inverse_rate": 1 / 100}}
"""Of a limit that is not reached a fit sees nothing; the others begin at no strength."""


def command():
    """Charge, waves about a shut valve, empty in part, lift again [V]; 0.7 s."""
    t = np.arange(350) * STEP
    waves = 2.0 * np.sin(2 * np.pi * 6 * (t - 0.2))
    return np.select([t < 0.15, t < 0.2, t < 0.45, t < 0.55], [3.5, 0.0, waves, -2.0], 2.5)


def recorded(machine, seed=0):
    """Readings of a machine with noise of the sensors."""
    readings = bench.simulated(machine, bench.isotonic_track(command()), 4).readings
    rng = np.random.default_rng(seed)
    noisy = {name: np.asarray(readings[name]) + s * rng.normal(size=350) for name, s in NOISE.items()}
    return jm.recording(machine, {"command": command(), **noisy}, STEP, noise=NOISE)


@pytest.mark.thorough
@pytest.mark.parametrize("name", TRUE)
def test_the_strength_is_found(name):
    recording = recorded(bench.model("isotonic", **{name: TRUE[name]}))
    (strength, true), *_ = TRUE[name].items()
    machine = bench.model("isotonic", **{name: BEGIN.get(name, {})})
    fit = jm.fit(machine, recording, [f"{name}.{strength}"])
    found = fit.parameters[f"effects.{name}.{strength}"]
    assert fit.converged
    assert abs(found.value - true) < min(4 * found.std, 0.05 * abs(true))
    assert float(get(fit.actuator, f"effects.{name}.{strength}")) == pytest.approx(found.value)


PRESSURES = {
    "valve_offset": {"offset": 3e3},
    "valve_hysteresis": {"half_width": 4e3},
    "dead_band": {"width": 5e3},
    "rate_limit": {"inverse_rate": 1 / 1.5e6},
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PRESSURES)
def test_the_strength_is_found_where_commands_are_pressures(name):
    command = bench.joint_command()[50:400]
    true_machine = bench.model("joint", **{name: PRESSURES[name]})
    readings = bench.simulated(true_machine, bench.joint_track(command), 4).readings
    rng, noise = np.random.default_rng(0), {"pressure": 400.0, "angle": 1e-4}
    noisy = {n: np.asarray(readings[n]) + s * rng.normal(size=readings[n].shape) for n, s in noise.items()}
    columns = {f"command_{i + 1}": command[:, i] for i in (0, 1)}
    columns |= {f"pressure_{i + 1}": noisy["pressure"][:, i] for i in (0, 1)} | {"angle": noisy["angle"]}
    levels = {"pressure_1": 400.0, "pressure_2": 400.0, "angle": 1e-4}
    (strength, true), *_ = PRESSURES[name].items()
    begin = {"rate_limit": {"inverse_rate": 1 / 3e6}}
    machine = bench.model("joint", **{name: begin.get(name, {})})
    fit = jm.fit(machine, jm.recording(machine, columns, STEP, noise=levels), [f"{name}.{strength}"])
    found = fit.parameters[f"effects.{name}.{strength}"]
    assert fit.converged
    assert abs(found.value - true) < min(4 * found.std, 0.05 * abs(true))
