"""Rig `elbow` against its oracle: a regulator and the modified model of [W]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.elbow import elbow

import jaxmuscle as jm
from jaxmuscle.hysteresis import respond
from jaxmuscle.hysteresis.loop_fit import fit_loop
from jaxmuscle.parameters import get, parameters, replace

CARD, STEP = bench.CARDS["elbow"], bench.STEPS["elbow"]
COMMAND = bench.elbow_command()
CASES = {"bare": {}, "command_delay": {"command_delay": {"delay": 0.03}}}


@pytest.mark.parametrize("effects", CASES.values(), ids=CASES)
def test_equals_oracle(effects):
    pressure, angle = elbow(CARD, effects, COMMAND, STEP, COMMAND[0], 40)
    actuator = bench.model("elbow", ("command_delay",), **effects)
    readings = bench.simulated(actuator, bench.elbow_track(COMMAND), 20).readings
    # From 10 to 20 steps a sample the model moves by 4e-6 of the range of the pressure.
    assert bench.deviation(readings["pressure"], pressure) < 3e-6
    assert bench.deviation(readings["angle"], angle) < 3e-6
    assert np.ptp(angle) > np.deg2rad(80)


@pytest.mark.slow
def test_angle_under_measured_pressure_is_the_model_itself():
    """The memory is exact at any step: what the plays make of the samples is all there is."""
    pressure = elbow(CARD, {}, COMMAND, STEP, COMMAND[0], 10)[0]
    actuator = bench.model("elbow")
    track = bench.track("elbow", COMMAND, pressure=pressure)
    expected = respond(actuator.hysteresis, pressure - bench.AMBIENT)[1]
    start = jm.simulation.start_at_rest(actuator, track)
    for substeps in (1, 3):
        found = jm.simulation.run(
            actuator, track, start, jnp.asarray(0),
            samples=len(COMMAND), imposed=("pressure",), substeps=substeps,
        ).readings["angle"]  # fmt: skip
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_loop_is_unsymmetric_and_wide_enough_to_matter():
    _, angle = elbow(CARD, {}, COMMAND, STEP, COMMAND[0], 10)
    gauge = elbow(CARD, {}, COMMAND, STEP, COMMAND[0], 10)[0] - bench.AMBIENT
    up, down = slice(0, 70), slice(78, 105)
    between = np.interp(gauge[down], gauge[up], angle[up])
    assert (angle[down] - between).max() > np.deg2rad(5)


def test_slopes_equal_finite_differences_of_the_oracle():
    actuator, track = bench.model("elbow"), bench.elbow_track(COMMAND)
    names = ("rising_slope", "falling_level", "density", "decay", "spacing", "regulator_frequency")
    paths = [type(actuator).quantities[name] for name in names]

    def angle(factors):
        values = {path: get(actuator, path) * f for path, f in zip(paths, factors, strict=True)}
        return bench.simulate(replace(actuator, values), track, 8).readings["angle"]

    slopes = jax.jit(jax.jacfwd(angle))(jnp.ones(len(names)))
    for i, name in enumerate(names):
        higher, lower = (
            elbow({**CARD, name: CARD[name] * f}, {}, COMMAND, STEP, COMMAND[0], 8)[1]
            for f in (1 + 1e-5, 1 - 1e-5)
        )
        assert bench.deviation(slopes[:, i], (higher - lower) / 2e-5) < 1e-3, name


def test_a_card_describes_it():
    units = {
        "regulator_frequency": "Hz", "rising_slope": "1/bar", "falling_slope": "1/bar", "density": "deg",
        "linear": "deg/bar", "cubic": "deg/bar^3",
    }  # fmt: skip
    names = [n for n in CARD if n != "ambient_pressure"]
    degrees = 180 / np.pi
    factors = {"": 1.0, "Hz": 1.0, "1/bar": 1e5, "deg": degrees, "deg/bar": 1e5 * degrees}
    factors["deg/bar^3"] = 1e15 * degrees
    unit = {name: units.get(name, "") for name in names}
    known = {n: {"value": float(CARD[n]) * factors[unit[n]], "unit": unit[n]} for n in names}
    columns = {
        "time": {"column": "t", "unit": "s"},
        "angle": {"column": "theta", "unit": "deg"},
        **{n: {"column": n, "unit": "bar", "reference": "gauge"} for n in ("command", "pressure")},
    }
    card = jm.Card.parse({"rig": "elbow", "columns": columns, "known": known})
    entries = parameters(jm.actuator(card))
    for name, path in type(bench.model("elbow")).quantities.items():
        assert float(entries[path].value) == pytest.approx(CARD[name], rel=1e-12), name
    assert entries["hysteresis.cubic"].unit == "rad/Pa^3"


def test_refit_of_its_own_loop_finds_it_again():
    actuator, gauge = bench.model("elbow"), 1e5 * np.abs(5.8 * np.sin(np.arange(160) / 12.0)) + 1e4
    angle = respond(actuator.hysteresis, gauge)[1]
    wrong = replace(actuator.hysteresis, {"density": 0.05, "falling.level": 2.1, "rising.slope": 5.4e-6})
    held = [path for path in parameters(wrong) if path not in ("density", "falling.level", "rising.slope")]
    found = fit_loop(wrong, gauge, angle, held=held)
    assert found.rmse < 1e-4 * np.ptp(angle)
