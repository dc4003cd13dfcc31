"""Weights by what the model leaves: priors keep their meaning where it is incomplete."""

import dataclasses

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.errors import InputError

PRIOR = {"braid_angle": (np.deg2rad(20.0), np.deg2rad(0.1))}


def fitted(recording, noise):
    actuator = jm.actuator(recording.card)
    return jm.fit(actuator, recording, ["braid_angle"], priors=PRIOR, noise=noise)


@pytest.fixture(scope="module")
def recordings():
    """One that the model explains, and the same with forces along the contraction that it lacks."""
    whole = driven_recording({}, driven_card({}))
    columns = dict(whole.columns)
    columns["force"] = (
        columns["force"] + 40.0 * np.sin(columns["position"] / 0.006) - 2e3 * columns["position"]
    )
    return whole, dataclasses.replace(whole, columns=columns)


def test_nothing_changes_where_nothing_is_missing(recordings):
    whole, _ = recordings
    usual, allowing = fitted(whole, None), fitted(whole, "discrepancy")
    assert allowing.values["braid_angle"] == pytest.approx(usual.values["braid_angle"], rel=1e-4)
    assert allowing.std["braid_angle"] == pytest.approx(usual.std["braid_angle"], rel=0.3)


def test_a_prior_is_not_outweighed_by_thousands_of_rows_of_a_misfit(recordings):
    _, lacking = recordings
    mean, std = PRIOR["braid_angle"]
    usual, allowing = (fitted(lacking, noise).values["braid_angle"] for noise in (None, "discrepancy"))
    assert abs(usual - mean) > 2 * std
    assert abs(allowing - mean) < 0.7 * abs(usual - mean)


def test_the_floor_is_the_noise_of_the_sensor_and_what_is_left_counts_with_its_correlation(recordings):
    whole, lacking = recordings
    for recording, about in ((whole, 0.05), (lacking, 0.5)):
        usual, allowing = fitted(recording, None), fitted(recording, "discrepancy")
        (noise,), (wider,) = (next(iter(fit.noise.values())).values() for fit in (usual, allowing))
        excess = max((wider.residual / noise.assumed) ** 2 - 1, 0.0)
        expected = noise.assumed * np.sqrt(1 + excess * wider.autocorrelation_time)
        assert noise.assumed <= wider.assumed * 1.001
        # Twice taken anew from what was left the time before, which is not quite what is left at the end.
        assert wider.assumed == pytest.approx(expected, rel=about)
    assert wider.assumed > 100 * noise.assumed


def test_another_word_is_refused(recordings):
    with pytest.raises(InputError, match="expected 'estimated', 'discrepancy' or a mapping"):
        fitted(recordings[0], "guessed")
