"""What is missing at each instant, where the oracle knows it."""

import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven
from oracles.isotonic import isotonic
from oracles.recorded import NOISE, clock, driven_card, driven_recording, isotonic_card, smooth_motion

from jaxmuscle.diagnosis.discrepancy import missing_rates, rate_slopes
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get, replace
from jaxmuscle.recordings.recording import Recording

FRICTION = 25.0
SAMPLES = 400


@pytest.fixture(scope="module")
def lifted():
    """The oracle's lift under a guide friction of which the card knows nothing, its velocity, its rates."""
    command, step = bench.isotonic_command()[:SAMPLES], bench.STEPS["isotonic"]
    effects = {"load_friction": {"force": FRICTION}}
    pressure, position, velocity = isotonic(
        bench.CARDS["isotonic"], effects, command, step, bench.AMBIENT, substeps=20
    )
    columns = {"command": command, "pressure": pressure, "position": position}
    recording = Recording("oracle", None, None, isotonic_card(), clock(SAMPLES, step), step, columns)
    prepared = case(recording, 0.0)
    return velocity, pressure, {r.link.output: r for r in missing_rates(prepared, prepared.actuator)}


@pytest.mark.parametrize("sense", [1, -1])
def test_missing_acceleration_is_that_of_the_friction(lifted, sense):
    velocity, _, rates = lifted
    missing = rates["position"]
    assert (missing.link.signal, missing.unit) == ("load", "m/s^2")
    moving = sense * velocity > 0.04
    assert moving.sum() > 50
    found = missing.values["position"][moving]
    assert np.median(found) == pytest.approx(-sense * FRICTION / bench.CARDS["isotonic"]["mass"], rel=0.03)


def test_nothing_is_missing_in_the_pressure(lifted):
    _, pressure, rates = lifted
    missing = rates["pressure"]
    assert (missing.link.signal, missing.unit) == ("mass_flow", "Pa/s")
    rate = np.gradient(pressure, bench.STEPS["isotonic"])
    assert np.median(np.abs(missing.values["pressure"])) < 0.01 * np.abs(rate).max()


def test_missing_reading_of_a_driven_rig():
    """The force itself, sample by sample: what the oracle adds and the sensor's noise."""
    ends = {"pressure_dependent_ends": bench.ENDS}
    recording = driven_recording(ends, driven_card({}), seconds=6.0)
    prepared = case(recording, 0.3)
    (missing,) = missing_rates(prepared, prepared.actuator)
    assert (missing.link.output, missing.unit) == ("force", "N")
    modelled = driven(bench.CARDS["driven"], {}, *smooth_motion(6.0))
    expected = recording.columns["force"] - modelled
    np.testing.assert_allclose(missing.values["force"], expected, rtol=0, atol=0.02)
    np.testing.assert_allclose(missing.spread["force"], NOISE)
    assert np.abs(expected).max() > 10 * NOISE


@pytest.mark.parametrize("rig", ["isotonic", "driven"])
def test_slopes_by_free_parameters_equal_central_differences(rig):
    """By their coordinates: logarithms of positive parameters."""
    if rig == "driven":
        recording = driven_recording({}, driven_card({}), seconds=6.0)
    else:
        command, step = bench.isotonic_command()[:SAMPLES], bench.STEPS["isotonic"]
        card = bench.CARDS["isotonic"]
        pressure, position, _ = isotonic(card, {}, command, step, bench.AMBIENT, substeps=20)
        columns = {"command": command, "pressure": pressure, "position": position}
        recording = Recording("oracle", None, None, isotonic_card(), clock(SAMPLES, step), step, columns)
    prepared = case(recording, 0.0)
    model, station = prepared.actuator, workbench(prepared, [])
    paths = station.free_paths(model, []) or ["valve.area", "mass"]
    found = rate_slopes(prepared, model, station.unknowns(model, paths, []))
    assert paths and len(found) == len(model.links)
    for k, path in enumerate(paths):
        value = float(get(model, path))
        ends = [replace(model, {path: value * np.exp(change)}) for change in (-1e-5, 1e-5)]
        less, more = (missing_rates(prepared, each) for each in ends)
        for slopes, low, high in zip(found, less, more, strict=True):
            for column, table in slopes.items():
                assert table.shape == (len(recording), len(paths))
                expected = (high.values[column] - low.values[column]) / 2e-5
                size = np.abs(expected).max()
                np.testing.assert_allclose(table[:, k], expected, rtol=0, atol=2e-3 * size + 1e-12)
        assert max(np.abs(table[:, k]).max() for slopes in found for table in slopes.values()) > 0
