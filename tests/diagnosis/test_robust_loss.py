"""A diagnosis of a force into which someone bumps: by squares these few stretches bend everything."""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import STEP, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.diagnose import diagnose
from jaxmuscle.diagnosis.workbench import SLOW, workbench
from jaxmuscle.effects import BladderStiffness, Creep, PressureDependentEnds, ThreadFriction
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import Huber
from jaxmuscle.estimation.case import case
from jaxmuscle.report.doubts import doubts

SECONDS, BUMPS, LONG, HARD = 40.0, 8, 0.4, 60.0
"""Of the recording [s]; in it so many bumps of such length [s] and force [N], 75 times the sensor's noise."""
CATALOGUE = (ThreadFriction, PressureDependentEnds, BladderStiffness, Creep)
TRUE = bench.THREADS["kinetic_coefficient"]


def bumped():
    """A recording with thread friction that the card does not know, and bumps."""
    t = np.arange(round(SECONDS / STEP)) * STEP
    middles = (np.arange(BUMPS) + np.random.default_rng(0).random(BUMPS)) * SECONDS / BUMPS
    away = np.abs(t - middles[:, None]).min(axis=0)
    force = np.where(away < LONG / 2, HARD * np.cos(np.pi * away / LONG), 0.0)
    return driven_recording({"thread_friction": bench.THREADS}, driven_card({}), seconds=SECONDS, extra=force)


@pytest.fixture(scope="module")
def found():
    return {loss: diagnose(bumped(), catalogue=CATALOGUE, loss=loss) for loss in ("squares", "huber")}


def kinetic(diagnosis):
    return diagnosis.effects[0].parameters["kinetic_coefficient"]


@pytest.mark.slow
def test_the_effect_is_found_under_each_loss(found):
    for diagnosis in found.values():
        assert diagnosis.verdict == "effects found"
        assert [effect.name for effect in diagnosis.effects] == ["thread_friction"]


@pytest.mark.slow
def test_bumps_bend_values_by_squares_and_hardly_those_of_a_robust_loss(found):
    wrong = {loss: abs(kinetic(diagnosis).value - TRUE) for loss, diagnosis in found.items()}
    assert wrong["huber"] < 0.005 * TRUE < 0.03 * TRUE < wrong["squares"]
    assert wrong["huber"] < 3 * kinetic(found["huber"]).std < kinetic(found["squares"]).std


@pytest.mark.slow
def test_the_report_says_what_a_few_stretches_do_under_each_loss(found):
    said = [text for text in doubts(found["squares"]) if "--loss huber" in text]
    assert len(said) == 1 and said[0].startswith("A few stretches hold most of what is left")
    (told,) = (text for text in doubts(found["huber"]) if text.startswith("A few stretches hold"))
    assert "--loss" not in told and "counts these few little, and so does the verdict" in told
    assert {loss: each.settings["loss"] for loss, each in found.items()} == {n: n for n in found}


def test_secants_lead_to_the_minimum_of_the_loss():
    prepared = case(bumped(), 0.0)
    tools = workbench(prepared, [ThreadFriction], loss=Huber())
    problem = prepared.training.in_parts(4)
    exact, by_secants = (
        tools.fit(prepared.actuator, ["thread_friction"], problem, 60, slow)[1] for slow in (0.0, SLOW)
    )
    assert by_secants.cost == pytest.approx(exact.cost, rel=1e-3)
    squares = dataclasses.replace(tools, loss=jm.estimation.Squares())
    _, lane = squares.fit(prepared.actuator, ["thread_friction"], problem, 60)
    assert exact.cost < 0.2 * lane.cost


@pytest.mark.parametrize("loss", ["hubert", None, ["huber"], 1.345])
def test_a_loss_that_is_none_is_refused(loss):
    with pytest.raises(InputError, match="loss: unknown"):
        diagnose(bumped(), loss=loss)
