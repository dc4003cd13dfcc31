"""A recording as a machine sees it: nothing is smoothed across a break, sensors' noise from card or data."""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import NOISE, STEP, driven_card, driven_recording, smooth_motion

from jaxmuscle.recordings import actuator_from_card, read
from jaxmuscle.samples import sample
from jaxmuscle.simulation.observed import observed

BREAKS = (140, 300)
LINES = ((0.02, 0.001), (0.05, -0.004), (0.01, 0.007))
"""Position and velocity at the first sample of each of three runs [m, m/s]."""


@pytest.fixture(scope="module")
def runs():
    """Three straight motions, each begun anew, without noise."""
    recording = driven_recording({}, driven_card({}), seconds=5.0)
    edges, position, velocity = [0, *BREAKS, 500], [], []
    for (begin, rate), a, b in zip(LINES, edges[:-1], edges[1:], strict=True):
        position.append(begin + rate * STEP * np.arange(b - a))
        velocity.append(np.full(b - a, rate))
    columns = {**recording.columns, "position": np.concatenate(position)}
    return dataclasses.replace(recording, columns=columns, breaks=BREAKS), np.concatenate(velocity)


def test_nothing_is_smoothed_across_a_break(runs):
    recording, velocity = runs
    prepared = observed(actuator_from_card(recording.card), recording, {})
    measured = prepared.track.measured
    np.testing.assert_allclose(measured["contraction"], recording.columns["position"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(measured["velocity"], velocity, rtol=0, atol=1e-10)
    assert prepared.track.begins is not None
    np.testing.assert_array_equal(np.flatnonzero(prepared.track.begins), BREAKS)


def test_without_the_breaks_the_velocity_is_wrong(runs):
    recording, velocity = runs
    actuator = actuator_from_card(recording.card)
    whole = observed(actuator, dataclasses.replace(recording, breaks=()), {})
    assert whole.track.begins is None
    assert np.abs(whole.track.measured["velocity"] - velocity).max() > 0.1


def test_further_cuts_are_no_new_runs(runs):
    """Held-out rows are cut off for the smoothing, but the run goes on."""
    recording, velocity = runs
    once = dataclasses.replace(recording, breaks=BREAKS[:1])
    prepared = observed(actuator_from_card(recording.card), once, {}, cuts=BREAKS[1:])
    np.testing.assert_allclose(prepared.track.measured["velocity"], velocity, rtol=0, atol=1e-10)
    assert prepared.track.begins is not None
    np.testing.assert_array_equal(np.flatnonzero(prepared.track.begins), BREAKS[:1])


def test_noise_is_the_cards_or_else_that_of_the_data():
    recording = driven_recording({}, driven_card({}), seconds=20.0)
    actuator = actuator_from_card(recording.card)
    assert float(observed(actuator, recording, {"force": 3.0}).noise["force"]) == 3.0
    assert float(observed(actuator, recording, {}).noise["force"]) == pytest.approx(NOISE, rel=0.1)


def test_smoothed_states_and_their_spread():
    recording = driven_recording({}, driven_card({}), seconds=20.0, seed=2)
    pressure, contraction, velocity = smooth_motion(20.0)
    level = 5e-5
    shaken = contraction + level * np.random.default_rng(8).normal(size=len(contraction))
    recording = dataclasses.replace(recording, columns={**recording.columns, "position": shaken})
    prepared = observed(actuator_from_card(recording.card), recording, {})
    measured = prepared.track.measured
    np.testing.assert_allclose(measured["pressure"], pressure, rtol=1e-4)
    assert np.abs(measured["contraction"] - contraction).std() < level
    assert np.abs(measured["velocity"] - velocity).std() < 0.1 * velocity.std()
    assert 0.1 * level < np.median(prepared.spread["contraction"]) < level
    np.testing.assert_array_equal(prepared.outputs["force"], recording.columns["force"])


def test_two_muscles_are_side_by_side():
    recording = read(sample("swing"))
    prepared = observed(actuator_from_card(recording.card), recording, recording.card.noise)
    assert prepared.track.command.shape == (6000, 2)
    assert prepared.track.measured["pressure"].shape == (6000, 2)
    assert prepared.track.measured["angle"].shape == (6000,)
    for i in (0, 1):
        np.testing.assert_array_equal(
            prepared.outputs["pressure"][:, i], recording.columns[f"pressure_{i + 1}"]
        )
    np.testing.assert_array_equal(prepared.noise["pressure"], [400.0, 400.0])
    assert bench.BLANKS["joint"].outputs.keys() == prepared.outputs.keys()
