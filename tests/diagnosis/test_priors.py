"""Priors keep their meaning while a model lacks something: a drive with friction that its card leaves out."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
import pytest
from estimation.own_rig import Drive as OwnDrive

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.settled_fit import SettledFit, best_of
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import LoadDamping, LoadFriction
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.optimization.descents import CONVERGED
from jaxmuscle.parameters import get
from jaxmuscle.progress import Meter

STEP, FINE = 0.01, 50
MASS, GAIN, COULOMB, VISCOUS, NOISE = 20.0, 10.0, 8.0, 60.0, 2e-5


class Drive(OwnDrive):
    """The same in steps that dry friction calls for."""

    rig: ClassVar = "drive-that-rubs"
    largest_step: ClassVar = 1e-3


def measured(seconds=24.0):
    """Command and position of a drive under a controller that makes it follow a smooth reference."""
    rng, rows = np.random.default_rng(5), round(seconds / STEP)
    time = np.arange(rows) * STEP
    wanted = 0.1 * np.sin(0.9 * time) + 0.06 * np.sin(2.3 * time + 0.4) + 0.03 * np.sin(4.1 * time)
    x = v = 0.0
    command, position = np.zeros(rows), np.zeros(rows)
    for i in range(rows):
        position[i] = x
        command[i] = (2500.0 * (wanted[i] - x) - 150.0 * v) / GAIN
        for _ in range(FINE):
            free = v + STEP / FINE * (GAIN * command[i] - VISCOUS * v) / MASS
            v = np.sign(free) * max(abs(free) - STEP / FINE * COULOMB / MASS, 0.0)
            x += STEP / FINE * v
    return {"command": command, "position": position + NOISE * rng.normal(size=rows)}


@pytest.fixture(scope="module", autouse=True)
def _registered():
    """For these tests only: others go over all rigs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(RIGS, Drive.rig, Drive)
        yield


@pytest.fixture(scope="module")
def recording():
    machine = Drive(mass=1.1 * MASS, gain=GAIN)  # pyright: ignore[reportArgumentType]
    return jm.recording(
        machine, measured(), STEP, noise={"position": NOISE}, horizon=0.8, uncertain={"mass": 0.3 * MASS}
    )


@pytest.mark.slow
def test_a_model_that_lacks_friction_is_not_bent_away_from_its_card(recording):
    """By the noise of the sensor alone the mass goes far beyond what the card allows."""
    mean, std = 1.1 * MASS, 0.05 * MASS
    card = recording.card.updated({"mass": (mean, std)})
    prepared = case(dataclasses.replace(recording, card=card), 0.3, None)
    bench = workbench(prepared, missing(prepared.actuator, (LoadFriction, LoadDamping)))
    parts = prepared.training.in_parts(4)

    def off(model):
        return abs(float(get(model, "mass")) - mean) / std

    bent, _ = bench.fit(bench.model, [], parts, 60)
    settled = bench.settled(bench.model, [], parts, 60)
    assert off(bent) > 5
    assert off(settled.model) < 0.2 * off(bent), (off(settled.model), off(bent))
    # What was fitted has the weights of what it leaves.
    again = bench.settled(settled.model, [], parts, 60)
    assert float(get(again.model, "mass")) == pytest.approx(float(get(settled.model, "mass")), rel=1e-2)
    for columns in settled.factors.values():
        assert (columns < 0.1).all()


def test_a_model_that_lacks_nothing_has_the_weights_of_the_sensors(recording):
    declared = {"load_friction": {"force": (COULOMB, None)}, "load_damping": {"coefficient": (VISCOUS, None)}}
    prepared = case(dataclasses.replace(recording, card=recording.card.updated({}, declared)), 0.3, None)
    bench = workbench(prepared, ())
    whole = forward_selection(prepared, bench, Meter(lambda progress: None))
    settled = bench.settled(whole.model, [], whole.training, 60)
    assert float(get(settled.model, "mass")) == pytest.approx(MASS, rel=0.02)
    assert all((columns > 0.3).all() for columns in settled.factors.values()), settled.factors


@pytest.mark.slow
def test_friction_and_damping_are_found(recording):
    found = jm.diagnose(recording, catalogue=(LoadFriction, LoadDamping, jm.effects.EndStop))
    assert found.verdict == "effects found"
    assert {effect.name for effect in found.effects} == {"load_friction", "load_damping"}
    values = {name: entry.value for name, entry in found.parameters.items()}
    assert values["mass"] == pytest.approx(MASS, rel=0.1)
    assert values["effects.load_friction.force"] == pytest.approx(COULOMB, rel=0.1)
    assert values["effects.load_damping.coefficient"] == pytest.approx(VISCOUS, rel=0.1)
    assert not found.violated_priors


def test_a_large_error_that_lasts_does_not_beat_a_small_one_that_does_not():
    """By its own correlation time each, 20 noise units over 500 samples would cost less than 2 over one."""

    def fitted(square, time):
        anything: Any = None
        return SettledFit(anything, 0.0, CONVERGED, {"force": [Discrepancy(2000, square, time)]}, 0.0)

    large, small = fitted(400.0, 500.0), fitted(4.0, 1.0)
    (by_itself,), (beside,) = large.left["force"], small.left["force"]
    assert by_itself.cost < beside.cost
    assert best_of([large, small]) == 1 and best_of([small, large]) == 0


def test_what_is_left_alike_is_decided_by_the_distance_from_the_card():
    anything: Any = None
    left = {"force": [Discrepancy(2000, 400.0, 500.0)]}
    assert best_of([SettledFit(anything, 0.0, CONVERGED, left, far) for far in (9.0, 1.0, 4.0)]) == 1
