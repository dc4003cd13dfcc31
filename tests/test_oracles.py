"""The oracles themselves, held against limits, values by hand, and finer steps; never against the models."""

from math import exp, pi, sqrt

import numpy as np
import pytest
from oracles.commands import acting
from oracles.driven import driven
from oracles.friction import BRISTLE_TIME, Bristles, course, guide_limit
from oracles.isotonic import GAS, drooped, isotonic, nozzle
from oracles.jetpipe import jet_pipe
from oracles.joint import joint
from oracles.muscle import corrected_force, cylinder, schulte_force
from oracles.sensors import readings

AMBIENT = 101325.0
MUSCLE = {"initial_length": 0.3, "initial_radius": 0.007, "braid_angle": np.deg2rad(20), "end_factor": 1.3,
          "ambient_pressure": AMBIENT}  # fmt: skip
LIFT = {**MUSCLE, "valve_area": 2e-6, "valve_time_constant": 7e-3, "full_command": 5.0, "mass": 12.0,
        "supply_pressure": AMBIENT + 6e5, "gas_temperature": 293.15, "polytropic_exponent": 1.0}  # fmt: skip
HELD = {**LIFT, "mass": 1e6, "valve_time_constant": 1e-3}
"""A mass that stays on the plate: a chamber of constant volume."""
TURN = {**MUSCLE, "regulator_frequency": 12.0, "regulator_damping": 0.85, "sprocket_radius": 0.015,
        "initial_contraction": 0.15, "inertia": 0.04}  # fmt: skip
VALVE = {"ambient_pressure": AMBIENT, "gas_temperature": 293.15, "supply_pressure": AMBIENT + 5.5e5,
         "stopper_position": 0.048, "current_gain": 0.1, "residual_force": 3.0, "polytropic_exponent": 1.4,
         "pipe_compliance": 0.8e-3, "pipe_saturation_force": 0.9, "receiver_offset": 0.099e-3,
         "discharge_coefficient": 0.7, "initial_pressure": 3e5}  # fmt: skip
THREADS = {"thread_friction": {"static_coefficient": 0.015, "kinetic_coefficient": 0.1,
                               "velocity_constant": 0.15}}  # fmt: skip
STEP = 2e-3
CHOKED = sqrt(1.4 / (GAS * 293.15)) * (2 / 2.4) ** 3
"""Choked mass flow per area and upstream pressure: sqrt(γ / R T) (2 / (γ + 1))^((γ + 1) / (2 (γ - 1)))."""
NOTHING = {
    "dead_band": {"width": 0.0},
    "valve_offset": {"offset": 0.0},
    "rate_limit": {"inverse_rate": 0.0},
    "valve_hysteresis": {"half_width": 0.0},
    "supply_droop": {"resistance": 0.0},
    "line_lag": {"time_constant": 0.0},
    "dead_volume": {"volume": 0.0},
    "gas_heating": {"share": 0.0, "thermal_time": 0.5},
    "wall_thickness": {"thickness": 0.0},
    "force_drift": {"share": 0.0, "time_constant": 3.0},
    "creep": {"stiffness": 0.0, "fast_time": 0.1, "slow_time": 1.0},
    "end_stop": {"position": 0.01, "stiffness": 0.0},
    "eccentric_sprocket": {"eccentricity": 0.0, "phase": 0.4, "wrap_angle": 2.0},
    "stribeck": {"excess": 0.0, "velocity_constant": 0.01},
    "presliding": {"distance": 0.0},
    "cogging": {"force": 0.0, "pitch": 0.01},
    "air_drag": {"coefficient": 0.0},
    "shaking": {"force": 0.0, "frequency": 2.0},
    "added_weight": {"force": 0.0, "time": 0.1},
    "supply_swing": {"share": 0.0, "frequency": 1.0},
}


def lifted(effects, command, substeps=6, card=LIFT):
    return isotonic(card, effects, command, STEP, AMBIENT, substeps)


def turned(effects, command, substeps=6):
    return joint(TURN, effects, command, STEP, tuple(command[0]), 0.0, substeps)


def strokes():
    t = np.arange(200) * STEP
    return np.select([t < 0.15, t < 0.3], [3.5, 2.5 * np.sin(40 * t)], -3.0)


def turns():
    t = np.arange(150) * STEP
    difference = 8e4 * np.sin(15 * t)
    return AMBIENT + 2.5e5 + np.stack([difference, -difference], axis=1)


@pytest.mark.parametrize("name", NOTHING)
def test_an_effect_of_no_size_changes_no_bit(name):
    declared = THREADS | {"load_friction": {"force": 0.3}}
    for simulated, command in ((lifted, strokes()), (turned, turns())):
        zero = {name: NOTHING[name]}
        np.testing.assert_array_equal(simulated(declared | zero, command), simulated(declared, command))


def test_command_by_hand():
    def told(effects, command):
        return acting(effects, np.array(command), 0.0, 1.0, 2)

    assert told({"dead_band": {"width": 0.4}}, [1.0, 0.3, -2.0]) == [0.6, 0.6, 0.0, 0.0, -1.6, -1.6]
    assert told({"valve_offset": {"offset": 0.1}}, [1.0]) == [1.1, 1.1]
    # Half a volt a substep from 0 on: the mean over each substep.
    assert told({"rate_limit": {"inverse_rate": 1.0}}, [1.0, -1.0]) == [0.25, 0.75, 0.75, 0.25]
    assert told({"command_delay": {"delay": 0.5}}, [1.0, 2.0]) == [0.0, 1.0, 1.0, 2.0]
    behind = told({"valve_hysteresis": {"half_width": 0.4}}, [1.0, 0.5, -1.0])
    assert behind == [0.6, 0.6, 0.6, 0.6, -0.6, -0.6]
    both = acting({"rate_limit": {"inverse_rate": 0.5}}, np.array([[1.0, 3.0]]), np.array([1.0, 1.0]), 1.0, 2)
    assert both == [[1.0, 1.5], [1.0, 2.5]]


def test_no_flow_within_the_dead_band():
    pressure, *_ = lifted({"dead_band": {"width": 0.5}}, np.full(100, 0.49))
    np.testing.assert_array_equal(pressure, AMBIENT)


def test_supply_droop_by_hand():
    assert nozzle(2e-6, 7e5, 1e5, 293.15) == pytest.approx(CHOKED * 2e-6 * 7e5, rel=1e-3)
    conductance, resistance = CHOKED * 2e-6, 5e7
    flow = drooped(2e-6, 7e5, 1e5, 293.15, resistance)
    assert flow == pytest.approx(conductance * 7e5 / (1 + conductance * resistance), rel=1e-3)
    for pressure in (3e5, 5e5, 6.9e5, 6.99999e5):
        flow = drooped(2e-6, 7e5, pressure, 293.15, resistance)
        assert flow == pytest.approx(nozzle(2e-6, 7e5 - resistance * flow, pressure, 293.15), rel=1e-9)
    assert drooped(2e-6, 7e5, 7.2e5, 293.15, resistance) == nozzle(2e-6, 7e5, 7.2e5, 293.15)


def test_chamber_by_hand():
    """Choked charging of a constant volume: a ramp of n R T q / V, and what each effect does to it."""
    volume, _ = cylinder(HELD, 0.0)
    ramp = GAS * 293.15 * CHOKED * 2e-6 * HELD["supply_pressure"] / volume
    t = np.arange(40) * STEP

    def charged(**effects):
        return lifted(effects, np.full(16, 5.0), 20, HELD)[0][8:] - AMBIENT

    t = t[8:16]
    np.testing.assert_allclose(charged(), ramp * (t - 1e-3), rtol=1e-6)
    assert 1.4 * charged()[-1] + AMBIENT < 0.528 * HELD["supply_pressure"]
    late = t - 1e-3 - 5e-3 * (1 - np.exp(-t / 5e-3))
    np.testing.assert_allclose(charged(line_lag={"time_constant": 5e-3}), ramp * late, rtol=5e-3)
    np.testing.assert_allclose(charged(dead_volume={"volume": volume / 4}), 0.8 * charged(), rtol=1e-6)
    adiabatic = charged(gas_heating={"share": 1.0, "thermal_time": 1e9})
    np.testing.assert_allclose(adiabatic, 1.4 * charged(), rtol=1e-4)
    # In a balance of heat brought and heat lost the gas is warmer by (γ - 1) τ q / m of its temperature.
    warm = charged(gas_heating={"share": 1.0, "thermal_time": 1e-3})
    np.testing.assert_allclose(warm - charged(), 0.4 * 1e-3 * ramp, rtol=1e-3)
    inner, _ = cylinder(HELD, 0.0, 5e-4)
    assert inner == pytest.approx(volume * (6.5 / 7) ** 2)
    wall = charged(wall_thickness={"thickness": 5e-4})
    np.testing.assert_allclose(wall, charged() * volume / inner, rtol=1e-6)


def test_heated_gas_cools_to_the_pressure_of_its_mass():
    """Charged for 20 ms and shut: adiabatic at first, and after ten times the time constant isothermal."""
    command = np.where(np.arange(300) < 10, 5.0, 0.0)
    heated = lifted({"gas_heating": {"share": 1.0, "thermal_time": 0.05}}, command, 20, HELD)[0] - AMBIENT
    cold = lifted({}, command, 20, HELD)[0] - AMBIENT
    assert heated[13] > 1.25 * cold[13]
    assert heated[-1] == pytest.approx(cold[-1], rel=2e-3)


def test_wall_is_virtual_work_on_the_inner_volume():
    card, wall = {**MUSCLE, "end_factor": 1.0}, {"wall_thickness": {"thickness": 8e-4}}
    plays = [0.0] * 8
    for x in (0.0, 0.02, 0.06):
        by_hand = (cylinder(card, x + 1e-6, 8e-4)[0] - cylinder(card, x - 1e-6, 8e-4)[0]) / 2e-6
        force = corrected_force(card, wall, x / 0.3, 3e5, plays)
        assert force == pytest.approx(3e5 * by_hand, rel=1e-6)
        assert cylinder(card, x, 8e-4)[1] == pytest.approx(by_hand, rel=1e-6)
    # Chou and Hannaford's term at rest: D90 = 14 mm / sin 20°, t = 0.8 mm; π (D90 t (2 sin - 1 / sin) - t²).
    added = pi * (0.014 / 0.3420201 * 8e-4 * (0.6840403 - 2.9238044) - 6.4e-7)
    at_rest = corrected_force(card, wall, 0.0, 1e5, plays) - schulte_force(card, 0.0, 1e5, 1.0)
    assert at_rest == pytest.approx(1e5 * added, rel=1e-6)


def test_end_stop_holds_what_the_muscle_pulls_too_much():
    effects = {"end_stop": {"position": 0.02, "stiffness": 2e5}, "load_damping": {"coefficient": 800.0}}
    pressure, position, velocity = lifted(effects, np.where(np.arange(500) < 75, 5.0, 0.0))
    pull = corrected_force(LIFT, {}, position[-1] / 0.3, pressure[-1] - AMBIENT, [0.0] * 8) - 12 * 9.80665
    assert abs(velocity[-1]) < 1e-6 and position[-1] - 0.02 == pytest.approx(pull / 2e5, rel=1e-4)
    assert pull > 200


def test_driven_by_hand():
    n = 200
    p, x, v = np.full(n, AMBIENT + 3e5), np.where(np.arange(n) < 1, 0.0, 0.03), np.zeros(n)
    still, t = driven(MUSCLE, {}, p, x, v), np.arange(n) * 0.01
    drifting = driven(MUSCLE, {"force_drift": {"share": 0.02, "time_constant": 3.0}}, p, x, v)
    np.testing.assert_allclose(drifting, still * (1 - 0.02 * (1 - np.exp(-t / 3))), rtol=1e-12)
    creep = {"creep": {"stiffness": 400.0, "fast_time": 0.1, "slow_time": 1.5}}
    # The strain goes to 0.1 along a ramp over the first sample, of 10 ms.
    late = [0.1 * (1 - time / 0.01 * np.expm1(0.01 / time) * np.exp(-t[1:] / time)) for time in (0.1, 1.5)]
    np.testing.assert_allclose(still[1:] - driven(MUSCLE, creep, p, x, v)[1:], 200 * sum(late), rtol=1e-4)


def test_readings_by_hand():
    value = np.linspace(0.0, 4.0, 5)
    true = {"pressure": value, "position": value, "force": value}

    def read(of, name, **parameters):
        return readings({name: parameters}, true, 0.5)[of]

    def named(name, **parameters):
        np.testing.assert_array_equal(read("force", name, column="position", **parameters), value)
        return read("position", name, column="position", **parameters)

    np.testing.assert_allclose(named("sensor_offset", offset=0.1), value + 0.1)
    np.testing.assert_allclose(named("sensor_gain", gain=-0.01), 0.99 * value)
    shown = read("pressure", "sensor_gain", column="pressure", gain=0.02)
    np.testing.assert_allclose(shown, value + 0.02 * (value - AMBIENT))
    np.testing.assert_allclose(named("sensor_drift", rate=0.2), value + 0.1 * np.arange(5))
    np.testing.assert_allclose(read("position", "backlash", half_width=1.0), [0, 0, 1, 2, 3])
    np.testing.assert_allclose(
        read("force", "force_sensor_nonlinearity", cubic=0.01), value + 0.01 * value**3
    )
    # Behind a ramp of 2 per second a lag of 0.25 s stays 0.5 (1 - exp(-t / 0.25)) behind.
    behind = value - 0.5 * (1 - np.exp(-np.arange(5) * 0.5 / 0.25))
    for column, name in (("pressure", "pressure_sensor_lag"), ("force", "force_sensor_lag")):
        np.testing.assert_allclose(read(column, name, time_constant=0.25), behind, rtol=1e-3)
        np.testing.assert_array_equal(read("position", name, time_constant=0.25), value)


def test_guide_by_hand():
    limit = guide_limit(
        {"load_friction": {"force": 8.0}, "stribeck": {"excess": 4.0, "velocity_constant": 0.01}}
    )
    assert limit(0.0) == 12.0 and limit(-0.01) == pytest.approx(8 + 4 / np.e) and limit(1.0) == 8.0
    assert course(limit)(1.0) == pytest.approx(2 / 3) and course(lambda v: 0.0)(1.0) == 1.0


def test_bristles_by_hand():
    """A spring for small displacements, the limit in steady sliding, a half of both when turned."""
    contact = Bristles(1e-4, course(guide_limit({"load_friction": {"force": 5.0}})))
    contact.slide(0.01, 1e-4)  # a hundredth of the distance
    assert contact.bend == pytest.approx(1 - exp(-0.01))
    contact.slide(0.01, 1.0)
    assert contact.share(0.01) == pytest.approx(1.0)
    contact.slide(-0.01, 1e-2 * np.log(2))
    assert contact.bend == pytest.approx(0.0, abs=1e-12)
    assert contact.share(-0.01) == pytest.approx(-BRISTLE_TIME * 100)
    near_rest = guide_limit(
        {"load_friction": {"force": 5.0}, "stribeck": {"excess": 5.0, "velocity_constant": 0.1}}
    )
    falling = Bristles(1e-4, course(near_rest))
    falling.slide(1.0, 1.0)
    assert falling.bend == pytest.approx(0.5) and falling.share(1.0) == pytest.approx(1.0)


@pytest.mark.slow
def test_short_bristles_are_sharp_friction():
    """Each shorter by four, the lift of 48 mm comes nearer to that under sharp friction by more than two."""
    effects, command = THREADS | {"load_friction": {"force": 20.0}}, strokes()
    sharp = lifted(effects, command, 40)[1]
    apart = [
        np.abs(lifted(effects | {"presliding": {"distance": d}}, command, 40)[1] - sharp).max()
        for d in (8e-4, 2e-4, 5e-5, 1.25e-5)
    ]
    assert all(longer > 2 * shorter for longer, shorter in zip(apart[:-1], apart[1:], strict=True))
    assert apart[-1] < 1.5e-4


def test_a_joint_on_bristles_gives_way_as_their_spring():
    """A torque below the limit turns it by torque over stiffness, F_c / δ for the bearing."""
    effects = {
        "load_friction": {"force": 0.5},
        "presliding": {"distance": 0.01},
        "load_damping": {"coefficient": 4.0},
    }
    command = np.tile(AMBIENT + np.array([1.02e5, 0.98e5]), (400, 1))
    late = turned(effects, command)[2, -1]
    strain = 0.15 + 0.015 * late / 0.3 * np.array([1, -1])
    forces = [schulte_force(TURN, e, p, 1.3) for e, p in zip(strain, (1.02e5, 0.98e5), strict=True)]
    torque = 0.015 * (forces[0] - forces[1])
    assert 0.02 < torque < 0.4
    bearing = 0.5 * (1 - np.exp(-late / 0.01))
    assert bearing == pytest.approx(torque, rel=0.05)


def test_eccentric_sprocket_by_hand():
    """At equal pressures the lever arms R + e and R - e turn it with 2 e F at first."""
    command = np.tile(AMBIENT + np.array([2e5, 2e5]), (3, 1))
    force = schulte_force(TURN, 0.15, 2e5, 1.3)
    beside = {"eccentricity": 1 / 15, "wrap_angle": pi}
    *_, rate = turned({"eccentric_sprocket": {**beside, "phase": 0.0}}, command)
    assert rate[1] / STEP == pytest.approx(2e-3 * force / TURN["inertia"], rel=1e-2)
    *_, upright = turned({"eccentric_sprocket": {**beside, "phase": pi / 2}}, command)
    in_line = {**beside, "wrap_angle": 0.0, "phase": 0.0}
    *_, alike = turned({"eccentric_sprocket": in_line}, command)
    assert max(abs(upright[1]), abs(alike[1])) < 1e-3 * abs(rate[1])


def test_regulators_by_hand():
    command = np.tile(AMBIENT + np.array([2e5, 2e5]), (150, 1))
    command[20:] += 5e4
    slow = turned({"rate_limit": {"inverse_rate": 2.5e-6}}, command)[0]
    assert np.diff(slow).max() / STEP == pytest.approx(4e5, rel=0.02)
    plain, lag = turned({}, command)[0], turned({"line_lag": {"time_constant": 0.02}}, command)[0]
    slope = (lag[2:] - lag[:-2]) / (2 * STEP)
    np.testing.assert_allclose(lag[1:-1] + 0.02 * slope, plain[1:-1], atol=600)


def test_jet_pipe_does_not_move_in_its_dead_band():
    still = jet_pipe(VALVE, {"dead_band": {"width": 0.3}}, np.full(30, 0.29), STEP, 16)
    np.testing.assert_array_equal(still, jet_pipe(VALVE, {}, np.zeros(30), STEP, 16))
    moved = jet_pipe(VALVE, {"dead_band": {"width": 0.3}}, np.full(30, 1.0), STEP, 16)
    np.testing.assert_allclose(moved, jet_pipe(VALVE, {}, np.full(30, 0.7), STEP, 16), rtol=1e-12)


ALL = {
    "isotonic": THREADS
    | {
        "load_friction": {"force": 12.0},
        "dead_band": {"width": 0.1},
        "rate_limit": {"inverse_rate": 5e-3},
        "valve_offset": {"offset": 0.02},
        "valve_hysteresis": {"half_width": 0.05},
        "supply_droop": {"resistance": 2e7},
        "line_lag": {"time_constant": 4e-3},
        "dead_volume": {"volume": 5e-6},
        "gas_heating": {"share": 0.5, "thermal_time": 0.3},
        "wall_thickness": {"thickness": 5e-4},
        "creep": {"stiffness": 300.0, "fast_time": 0.05, "slow_time": 0.5},
        "end_stop": {"position": 0.03, "stiffness": 1e5},
        "stribeck": {"excess": 6.0, "velocity_constant": 0.02},
        "presliding": {"distance": 1e-4},
    },
    "joint": THREADS
    | {
        "load_friction": {"force": 0.2},
        "stribeck": {"excess": 0.1, "velocity_constant": 0.1},
        "eccentric_sprocket": {"eccentricity": 0.03, "phase": 0.7, "wrap_angle": 2.0},
        "end_stop": {"position": 0.3, "stiffness": 5.0},
        "line_lag": {"time_constant": 1e-2},
        "rate_limit": {"inverse_rate": 1e-6},
        "presliding": {"distance": 7e-3},
    },
}


@pytest.mark.parametrize(("rig", "column", "noise"), [("isotonic", 1, 3e-5), ("joint", 2, 4e-4)])
def test_the_substeps_of_the_blind_benchmark_are_fine_enough(rig, column, noise):
    """With every effect at once: within a noise of what four times as many substeps give."""
    simulated, command = {"isotonic": (lifted, strokes()), "joint": (turned, turns())}[rig]
    coarse, fine = (simulated(ALL[rig], command, n)[column] for n in (6, 24))
    assert np.abs(coarse - fine).max() < noise
    assert np.ptp(fine) > 100 * noise


@pytest.mark.parametrize(
    ("rig", "force", "distance", "column", "noise"),
    [("isotonic", 12.0, 1e-5, 1, 3e-5), ("joint", 0.2, 1e-4, 2, 4e-4)],
)
def test_short_bristles_converge_with_the_square_of_the_substep(rig, force, distance, column, noise):
    """On the stiffest bristles of the blind benchmark: they are wrong by a fifth of the noise at most."""
    simulated, command = {"isotonic": (lifted, strokes()), "joint": (turned, turns())}[rig]
    effects = THREADS | {"load_friction": {"force": force}, "presliding": {"distance": distance}}
    fine = simulated(effects, command, 48)[column]
    errors = [np.abs(simulated(effects, command, n)[column] - fine).max() for n in (6, 12)]
    assert errors[0] < 0.2 * noise
    assert errors[0] > 3 * errors[1]
