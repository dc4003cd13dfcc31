"""The velocity with which a window begins, where the oracle knows it."""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.isotonic import isotonic
from oracles.recorded import clock, driven_card, driven_recording, isotonic_card

from jaxmuscle.diagnosis.prediction_errors import begun
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import replace
from jaxmuscle.recordings.recording import Recording

NOISE = {"pressure": 400.0, "position": 1e-4}


@pytest.fixture(scope="module")
def lifted():
    """A lift without friction seen by a coarse position sensor, its windows, and the true velocity."""
    command, step = bench.isotonic_command(), bench.STEPS["isotonic"]
    pressure, position, velocity = isotonic(
        bench.CARDS["isotonic"], {}, command, step, bench.AMBIENT, substeps=20
    )
    rng = np.random.default_rng(8)
    columns = {
        "command": command,
        "pressure": pressure + NOISE["pressure"] * rng.normal(size=len(command)),
        "position": position + NOISE["position"] * rng.normal(size=len(command)),
    }
    card = dataclasses.replace(isotonic_card(), horizon=0.1, noise=NOISE)
    recording = Recording("oracle", None, None, card, clock(len(command), step), step, columns)
    prepared = case(recording, 0.0)
    return prepared, velocity[prepared.windows.rows]


def error(problem, true):
    return np.asarray(problem.track.measured["velocity"])[np.asarray(problem.rows)] - true


def test_the_model_sharpens_what_smoothing_says(lifted):
    prepared, true = lifted
    smoothed = error(prepared.problem, true)
    sharpened = error(begun(prepared, prepared.actuator), true)
    # On its plate the mass does not move, whatever velocity it begins with, and a landing within a window is
    # not linear in it.
    position = prepared.recording.columns["position"]
    samples = prepared.windows.samples
    lands = [position[row : row + samples].min() < 3 * NOISE["position"] for row in prepared.windows.rows]
    moving = (true != 0) & ~np.array(lands)
    assert moving.sum() > 10
    assert np.sqrt(np.mean(sharpened[moving] ** 2)) < 0.5 * np.sqrt(np.mean(smoothed[moving] ** 2))


def test_only_the_beginnings_are_touched(lifted):
    prepared, _ = lifted
    before, after = (p.track.measured for p in (prepared.problem, begun(prepared, prepared.actuator)))
    others = np.ones(len(before["velocity"]), dtype=bool)
    others[prepared.windows.rows] = False
    np.testing.assert_array_equal(before["velocity"][others], after["velocity"][others])
    np.testing.assert_array_equal(before["position"], after["position"])


def test_what_smoothing_knows_well_stays(lifted):
    """A prior of a tiny deviation, and a model that is far off: the smoothed velocity keeps its say."""
    prepared, _ = lifted
    sure = {name: values * 1e-6 for name, values in prepared.observed.spread.items()}
    certain = dataclasses.replace(prepared, observed=dataclasses.replace(prepared.observed, spread=sure))
    heavy = replace(prepared.actuator, {"mass": 20.0})
    before, after = (p.track.measured["velocity"] for p in (certain.problem, begun(certain, heavy)))
    np.testing.assert_allclose(before, after, atol=1e-6)


def test_a_start_without_any_doubt_stays(lifted):
    """Readings that do not move in their last digit leave a spread of zero."""
    prepared, _ = lifted
    sure = {name: np.where(np.arange(len(values)) < 300, 0.0, values)
            for name, values in prepared.observed.spread.items()}  # fmt: skip
    certain = dataclasses.replace(prepared, observed=dataclasses.replace(prepared.observed, spread=sure))
    before, after = (
        p.track.measured["velocity"] for p in (certain.problem, begun(certain, certain.actuator))
    )
    np.testing.assert_array_equal(before[:300], after[:300])
    assert np.isfinite(after).all() and not np.array_equal(before[300:], after[300:])


def test_what_the_past_tells_is_not_sharpened_by_what_comes(lifted):
    recording = lifted[0].recording
    card = dataclasses.replace(recording.card, state_from="past")
    prepared = case(dataclasses.replace(recording, card=card), 0.3)
    assert begun(prepared, prepared.actuator) is prepared.problem


def test_an_imposed_velocity_stays():
    prepared = case(driven_recording({}, driven_card({})), 0.0)
    assert begun(prepared, prepared.actuator) is prepared.problem
