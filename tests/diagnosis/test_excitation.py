"""Which effects can show in a recording: those whose input moves."""

import dataclasses

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.dependence import variables
from jaxmuscle.diagnosis.excitation import (
    columns_moving_within_a_segment,
    excited,
    is_still,
    moving_columns,
    training_segments,
)
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings.joining import joined

NOISE = 0.3
"""Of the force [N]."""


def isometric(*contractions, position_noise=0.0, rows=400):
    """A test machine holds a muscle at these contractions [m], one run each, while the pressure swings."""
    whole = jm.read(jm.sample("bench"))
    card = dataclasses.replace(
        whole.card, noise={"force": NOISE} | ({"position": position_noise} if position_noise else {})
    )
    rng, runs = np.random.default_rng(3), []
    for contraction in contractions:
        time = whole.step * np.arange(rows, dtype=np.float64)
        columns = {
            "pressure": 101325 + 3e5 + 2e5 * np.sin(2 * np.pi * time / 0.4),
            "position": contraction + position_noise * rng.normal(size=rows),
            "force": np.zeros(rows),
        }
        run = jm.Recording("held", None, None, card, time, whole.step, columns)
        force = np.asarray(jm.simulate(jm.actuator(card), run).readings["force"])
        runs.append(
            dataclasses.replace(run, columns={**columns, "force": force + NOISE * rng.normal(size=rows)})
        )
    return joined(runs, "held")


def offered(recording):
    prepared = case(recording, 0.3)
    bare = prepared.actuator.without_effects(*prepared.actuator.effects)
    return {effect.name for effect in excited(prepared, bare, missing(bare, CATALOGUE))}


@pytest.mark.slow
@pytest.mark.parametrize("position_noise", [0.0, 2e-5])
def test_an_isometric_test_excites_no_friction_hysteresis_or_creep(position_noise):
    found = offered(isometric(0.02, position_noise=position_noise))
    assert found.isdisjoint({"thread_friction", "length_hysteresis", "creep", "bladder_hoop_stiffness"})
    assert {"pressure_dependent_ends", "force_sensor_lag"} <= found


@pytest.mark.slow
def test_several_lengths_excite_what_depends_on_the_length_alone():
    """But not what needs a motion while it is watched."""
    found = offered(isometric(0.01, 0.03, 0.05, rows=300))
    assert {"bladder_hoop_stiffness", "bladder_stiffness"} <= found
    assert found.isdisjoint({"thread_friction", "length_hysteresis", "creep"})


def test_where_everything_moves_every_effect_is_offered():
    recording = jm.read(jm.sample("bench"))
    prepared = case(recording, 0.3)
    wanted = missing(prepared.actuator, CATALOGUE)
    assert excited(prepared, prepared.actuator, wanted) == wanted


def test_variables_that_rest_explain_nothing():
    assert set(variables(case(isometric(0.02), 0.3))) == {"pressure"}
    prepared = case(isometric(0.01, 0.03, 0.05, rows=300), 0.3)
    assert set(variables(prepared)) == {"pressure", "position"}
    assert moving_columns(prepared) - columns_moving_within_a_segment(prepared) == {"position"}


def test_segments_end_at_breaks_and_before_what_is_held_out():
    segments = training_segments(case(isometric(0.01, 0.03, rows=300), 0.25))
    assert [(int(rows[0]), int(rows[-1])) for rows in segments] == [(0, 299), (300, 449)]


def test_a_signal_within_its_noise_is_still():
    values = 0.5 + 1e-4 * np.random.default_rng(0).normal(size=500)
    assert is_still(values, 1e-4) and not is_still(values, 1e-5)
    assert is_still(np.full(10, 2.0), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("unexplained", [False, True])
def test_a_diagnosis_of_an_isometric_test_comes_to_its_end(unexplained):
    """It had crashed on the velocity, a variable that is constant."""
    recording = isometric(0.02, rows=800)
    if unexplained:
        pressure = recording.columns["pressure"]
        odd = recording.columns["force"] + 40 * np.sin(pressure / 2e4)
        recording = dataclasses.replace(recording, columns={**recording.columns, "force": odd})
    few = [effect for effect in CATALOGUE if effect.name in ("thread_friction", "pressure_dependent_ends")]
    found = jm.diagnose(recording, catalogue=few)
    assert found.verdict == ("unexplained" if unexplained else "complete")
    assert not found.effects
    if unexplained:
        assert found.unexplained[0].depends_on == ("pressure",)
