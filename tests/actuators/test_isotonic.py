"""Rig `isotonic` against its oracle and against closed forms."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.isotonic import isotonic

import jaxmuscle.effects.slip
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.isotonic import STANDARD_GRAVITY
from jaxmuscle.components.gas import CRITICAL_RATIO
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace

SMOOTH = {
    "bare": {},
    "chamber_leak": {"chamber_leak": {"area": 1.5e-7}},
    "command_delay": {"command_delay": {"delay": 0.024}},
    "load_damping": {"load_damping": {"coefficient": 80.0}},
    "bladder_stiffness": {"bladder_stiffness": bench.BLADDER},
    "pressure_dependent_ends": {"pressure_dependent_ends": bench.ENDS},
    "length_hysteresis": {"length_hysteresis": bench.LOOP},
}
DRY = {
    "load_friction": {"load_friction": {"force": 20.0}},
    "thread_friction": {"thread_friction": bench.THREADS},
    "together": {
        "thread_friction": bench.THREADS,
        "load_friction": {"force": 10.0},
        "chamber_leak": {"area": 1e-7},
        "length_hysteresis": bench.LOOP,
        "pressure_dependent_ends": bench.ENDS,
    },
}
CASES = {**SMOOTH, **DRY, "fractional_delay": {"command_delay": {"delay": 0.0246}}}
CARRIED = (*(name for name in SMOOTH if name != "bare"), "thread_friction", "load_friction")
COMMAND = bench.isotonic_command()


@cache
def reference(name):
    card, step = bench.CARDS["isotonic"], bench.STEPS["isotonic"]
    return isotonic(card, CASES[name], COMMAND, step, bench.AMBIENT, substeps=40 if name in DRY else 20)


def deviations(name, simulate=bench.simulated):
    pressure, position, velocity = reference(name)
    assert_rich(pressure, position, velocity, dry=name in DRY)
    actuator = bench.model("isotonic", CARRIED, **CASES[name])
    readings = simulate(actuator, bench.isotonic_track(COMMAND), 64).readings
    return bench.deviation(readings["pressure"], pressure), bench.deviation(readings["position"], position)


def assert_rich(pressure, position, velocity, dry):
    """The run visits every regime that the comparison is to cover."""
    landed = np.flatnonzero((position == 0) & (np.arange(len(position)) > 400))
    assert len(landed) > 10 and position[:400].max() > 0.04 and position[landed[-1] :].max() > 0.02
    supply = pressure / bench.CARDS["isotonic"]["supply_pressure"]
    ambient = bench.AMBIENT / pressure
    for ratio, flowing in ((supply, COMMAND > 1), (ambient, COMMAND < -1)):
        assert ratio[flowing].min() < CRITICAL_RATIO - 0.1 and ratio[flowing].max() > CRITICAL_RATIO + 0.1
    if dry:
        assert ((velocity == 0) & (position > 0)).sum() > 8


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
def test_equals_oracle(name):
    # From 64 to 128 steps a sample the model moves by up to 5e-4 of the range, because it meets the plate at
    # the end of a step and the pressure depends on when the fall ends; the oracle, from 20 to 40, by 6e-5.
    pressure, position = deviations(name)
    assert pressure < 1e-3
    assert position < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", DRY)
def test_equals_oracle_with_dry_friction(name):
    # Beside the steps (above), what a sticking time of 0.5 ms leaves: 0.14 % of the position's range.
    pressure, position = deviations(name)
    assert pressure < 2e-3
    assert position < 2e-3


def test_dry_friction_approaches_the_sharp_law(monkeypatch):
    _, position = deviations("load_friction")
    monkeypatch.setattr(jaxmuscle.effects.slip, "STICKING_TIME", 1e-4)
    jax.clear_caches()  # What was traced holds the constant as it was.
    _, sharper = deviations("load_friction")
    jax.clear_caches()
    assert sharper < position / 4


@pytest.mark.slow
def test_fractional_delay_is_close_to_the_true_one():
    # Within an interval the model acts with the mean of the delayed command; the spool (7 ms against a
    # step of 2 ms) averages it anyway.
    pressure, position = deviations("fractional_delay")
    assert pressure < 2e-3
    assert position < 1e-3


def test_sealed_gas_keeps_its_polytropic_constant():
    actuator = bench.model("isotonic")
    track = bench.track("isotonic", np.zeros(250), pressure=4e5, position=0.01, velocity=0.0)
    run = bench.simulated(actuator, track, 16)
    pressure, position = run.readings["pressure"], run.readings["position"]
    constant = pressure * actuator.muscle.volume(position) ** actuator.polytropic_exponent
    assert np.ptp(position) > 0.02
    np.testing.assert_allclose(constant, constant[0], rtol=1e-5)


def test_lifts_off_when_the_force_reaches_the_weight():
    actuator = bench.model("isotonic")
    muscle, weight = actuator.muscle, actuator.mass * STANDARD_GRAVITY
    per_pascal = muscle.force(jnp.asarray(0.0), jnp.asarray(1.0), muscle.end_factor)
    track = bench.track("isotonic", np.full(100, 0.5), pressure=bench.AMBIENT, position=0.0, velocity=0.0)
    readings = bench.simulated(actuator, track, 16).readings
    moving = np.flatnonzero(readings["position"] > 0)[0]
    lift_off = bench.AMBIENT + weight / per_pascal
    assert readings["pressure"][moving - 2] < lift_off < readings["pressure"][moving]


def test_choked_charging_fills_the_muscle_at_a_constant_rate():
    actuator = replace(bench.model("isotonic"), {"mass": 500.0, "valve.time_constant": 1e-3})
    track = bench.isotonic_track(np.full(36, 2.5))
    pressure = bench.simulated(actuator, track, 16).readings["pressure"]
    assert pressure[-1] < CRITICAL_RATIO * actuator.valve.supply_pressure
    # Choked air: 0.0404 A p / sqrt(T).
    inflow = 0.040418 * 1e-6 * actuator.valve.supply_pressure / np.sqrt(293.15)
    rate = 1.2 * 287.0 * 293.15 * inflow / actuator.muscle.volume(jnp.asarray(0.0))
    np.testing.assert_allclose(np.diff(pressure)[10:] / 2e-3, rate, rtol=1e-4)


def test_a_rig_with_a_command_that_does_not_say_how_it_rests_is_told():
    with pytest.raises(InputError, match=r"Isotonic: expected a method resting_command.*commands command"):
        AbstractActuator.resting_command(bench.model("isotonic"), {})
