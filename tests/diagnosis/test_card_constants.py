"""Constants of the card that are wrong: named as such, and only where no effect does as well."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.candidates import of_strength, paths_of, without
from jaxmuscle.diagnosis.card_constants import LAWS, CardConstant, card_constants
from jaxmuscle.diagnosis.constant_ranking import MOST_OF_IT, beside, explains, is_clear
from jaxmuscle.diagnosis.evidence import Evidence
from jaxmuscle.diagnosis.ranking import Candidate, Ranking
from jaxmuscle.diagnosis.verdict import beyond_machines, doubted
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import (
    BladderStiffness,
    Creep,
    LengthHysteresis,
    LoadFriction,
    PressureDependentEnds,
)
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get, replace
from jaxmuscle.report.doubts import doubts
from jaxmuscle.report.page import page
from jaxmuscle.report.report_files import fitted_card, result
from jaxmuscle.report.sentence import sentence

ANGLE = bench.CARDS["driven"]["braid_angle"]
IMITATORS = (BladderStiffness, Creep, LengthHysteresis, LoadFriction, PressureDependentEnds)
"""Effects by which a wrong constant may be made up for: fewer than all take less time."""


@pytest.fixture(scope="module")
def diagnosis():
    """A card with a braid angle 20 % off, and a force by the page of equations that has the right one."""
    card = driven_card(bench.THREADS, braid_angle=1.2 * ANGLE)
    recording = driven_recording({"thread_friction": bench.THREADS}, card, seed=3)
    return jm.diagnose(recording, catalogue=IMITATORS)


@pytest.mark.slow
def test_a_wrong_braid_angle_is_found_and_nothing_else(diagnosis):
    assert diagnosis.verdict == "effects found"
    (found,) = diagnosis.effects
    assert (found.name, found.kind, found.signal) == ("constant:braid_angle", "constant:braid_angle", "card")
    (angle,) = found.parameters.values()
    assert abs(angle.value - ANGLE) < 3 * angle.std and angle.std < 0.01 * ANGLE
    assert found.declared == pytest.approx(1.2 * ANGLE)
    assert (
        diagnosis.after["held_out"]["force"].in_noise < 1.2 < diagnosis.before["held_out"]["force"].in_noise
    )
    assert diagnosis.violated_priors == {}, "the radius need not make up for it"
    assert float(diagnosis.model.muscle.braid_angle) == angle.value
    assert "length_hysteresis" in [other.name for other in diagnosis.alternatives if other.told_apart]


@pytest.mark.slow
def test_it_is_told_as_a_constant_everywhere(diagnosis):
    said = sentence(diagnosis)
    assert "with a braid angle of 0.349" in said and "and not 0.4189 rad as on the card" in said
    assert "adding" not in said
    (told,) = result(diagnosis)["effects"]
    assert told["name"] == "constant:braid_angle" and told["on_the_card"] == pytest.approx(1.2 * ANGLE)
    assert told["parameters"]["braid_angle"]["unit"] == "rad"
    entry = fitted_card(diagnosis).uncertain["braid_angle"]
    assert entry.value == pytest.approx(ANGLE, rel=0.01) and fitted_card(diagnosis).effects.keys() == {
        "thread_friction"
    }
    html = page(diagnosis)
    assert "The card&#39;s braid angle" in html and "constant:" not in html
    assert "What is wrong on the card" in html and "on the card</dt><dd><b>0.4189 rad" in html
    assert not any("braid" in doubt for doubt in doubts(diagnosis))
    assert "braid_angle" in diagnosis.settings["constants"]


@pytest.mark.slow
def test_it_is_read_back_from_a_file(diagnosis, tmp_path):
    again = jm.Diagnosis.load(diagnosis.save(tmp_path / "saved.json"))
    assert again.effects == diagnosis.effects and again.effects[0].is_constant
    assert sentence(again) == sentence(diagnosis)


@pytest.mark.thorough
def test_a_wrong_mass_is_found_in_a_lift():
    """Beside guide friction that is really there; mass and radius make one motion, and are named together."""
    machine, step = bench.model("isotonic"), bench.STEPS["isotonic"]
    command = np.tile(bench.isotonic_command(), 4)
    readings = jm.simulate(machine, command, np.arange(len(command)) * step).readings
    noise, rng = {"pressure": 300.0, "position": 5e-5}, np.random.default_rng(1)
    columns = {n: np.asarray(readings[n]) + s * rng.normal(size=len(command)) for n, s in noise.items()}
    wrong = replace(machine, {"mass": 1.2 * float(get(machine, "mass"))})
    recording = jm.recording(wrong, {"command": command, **columns}, step, noise=noise, horizon=0.425)
    found = jm.diagnose(recording, catalogue=IMITATORS)
    assert found.verdict == "effects found"
    named = [effect.name for effect in found.effects]
    rivals = [other.name for other in found.alternatives if not other.told_apart]
    assert all(name.startswith("constant:") for name in named) and "constant:mass" in [*named, *rivals]
    assert all(error.in_noise < 1.3 for error in found.after["held_out"].values())


@pytest.fixture(scope="module")
def prepared():
    return case(jm.read(jm.sample("lift")).part(0, 3000), 0.3)


def constant(prepared, quantity):
    return next(each for each in card_constants(prepared) if each.quantity == quantity)


def test_constants_are_what_somebody_measured(prepared):
    found = {each.quantity: each for each in card_constants(prepared)}
    assert {"mass", "braid_angle", "initial_length", "supply_pressure", "valve_area"} <= set(found)
    assert not {*LAWS} & set(found)
    assert found["mass"].std is None and found["valve_area"].std == pytest.approx(0.2e-6)
    assert all(each.lower <= each.declared <= each.upper for each in found.values())
    assert np.rad2deg(found["braid_angle"].upper) == pytest.approx(54.7356, abs=1e-3)
    assert (found["full_command"].lower, found["full_command"].upper) == pytest.approx((0.5, 50.0))


def test_a_freed_constant_has_bounds_and_no_prior(prepared):
    tools = workbench(prepared, [], card_constants(prepared))
    names = ["constant:mass", "constant:valve_area"]
    free = tools.free_paths(tools.model, names)
    assert free == [*tools.declared, "mass"], "an uncertain one is free anyway"
    entries = {each.place.path: each for each in tools.unknowns(tools.model, free, names).entries}
    assert entries["mass"].prior is None and entries["valve.area"].prior is None
    assert entries["muscle.end_factor"].prior is not None
    assert (entries["mass"].lower, entries["mass"].upper) == (1e-4, 1e5)
    assert set(free) <= set(tools.order(tools.model, names))


def test_a_freed_constant_begins_within_its_range_wherever_a_fit_has_left_it(prepared):
    """Under the card's prior alone an uncertain constant may go below a tenth of the card's value."""
    tools = workbench(prepared, [], card_constants(prepared))
    area = constant(prepared, "valve_area")
    for value in (0.3 * area.lower, 3 * area.upper):
        model = replace(tools.model, {area.path: value})
        (entry,) = tools.unknowns(model, [area.path], [area.name]).entries
        assert entry.start in (area.lower, area.upper)
        (entry,) = tools.unknowns(model, [area.path], []).entries
        assert entry.start == value, "under its prior it has no range"


@pytest.mark.slow
def test_slopes_by_constants_are_finite_differences(prepared):
    tools = workbench(prepared, [], card_constants(prepared))
    problem = prepared.training.in_parts(4)
    names = ["constant:mass", "constant:braid_angle", "constant:initial_length"]
    paths = [constant(prepared, name.partition(":")[2]).path for name in names]
    rows = sum(np.asarray(w).size for w in problem.weights.values())
    residual, slopes = tools.jacobian(tools.model, problem, paths, names)
    for path, slope in zip(paths, slopes, strict=True):
        value = float(get(tools.model, path))
        up, down = (
            tools.jacobian(replace(tools.model, {path: value * (1 + h)}), problem, paths, names)[0]
            for h in (1e-6, -1e-6)
        )
        difference = (up - down) / (2e-6 * value)
        # Windows in which a motion sticks or slips for one of the two have no slope.
        near = np.abs(difference - slope) < 1e-3 * np.abs(slope).max()
        assert residual.size >= rows and near.mean() > 0.99 and np.abs(slope).max() > 0


def test_a_constant_changes_nothing_at_the_value_of_the_card(prepared):
    mass = constant(prepared, "mass")
    model = replace(prepared.actuator, {"mass": 9.0})
    assert without(mass) == {"mass": 8.0} and paths_of(model, mass.name) == ["mass"]
    assert of_strength(mass, 0.5, model) == {"mass": 9.5}
    assert of_strength(mass, -20.0, model) == {"mass": mass.lower}


def candidate(prepared, sought, left, gain, value=10.0, p_value=1e-4):
    """A candidate that leaves errors of `left` noise units in each of 20 blocks."""
    model = replace(prepared.actuator, {"mass": value})
    losses = np.full((1, 20), np.log1p(1 + left**2)) + 1e-3 * np.arange(20)
    return Candidate((sought,), Evidence(gain, p_value, left, 20), losses, model, (model,))


def ranking(*candidates):
    return Ranking(400.0, (), tuple(candidates), 1)


@pytest.mark.parametrize(
    ("effect", "mass", "clear"),
    [
        ({"left": 20.0, "gain": 0.02, "p_value": 1.0}, {"left": 0.0, "gain": 0.99}, True),
        ({"left": 9.0, "gain": 0.4}, {"left": 0.0, "gain": 0.99}, True),
        # The effect explains as well: it goes first.
        ({"left": 0.0, "gain": 0.99}, {"left": 0.0, "gain": 0.99}, False),
        ({"left": 5.0, "gain": 0.8}, {"left": 4.9, "gain": 0.81}, False),
        # Too little of what is missing, too weak, or within what the card says.
        ({"left": 20.0, "gain": 0.02, "p_value": 1.0}, {"left": 9.0, "gain": MOST_OF_IT - 0.01}, False),
        ({"left": 20.0, "gain": 0.02, "p_value": 1.0}, {"left": 0.0, "gain": 0.99, "p_value": 0.006}, False),
        ({"left": 20.0, "gain": 0.02, "p_value": 1.0}, {"left": 0.0, "gain": 0.99, "value": 8.0}, False),
    ],
)
def test_an_effect_goes_first_unless_a_constant_is_clearly_better(prepared, effect, mass, clear):
    effects = ranking(candidate(prepared, LoadFriction, **effect))
    best = candidate(prepared, constant(prepared, "mass"), **mass)
    assert is_clear(best, effects, 0) is clear
    both = beside(effects, ranking(best), 0)
    assert next(each.name for each in both.candidates) == ("constant:mass" if clear else "load_friction")
    assert len(both.candidates) == 2


def test_an_uncertain_value_has_to_contradict_the_card(prepared):
    mass = dataclasses.replace(constant(prepared, "mass"), std=1.0)
    assert not explains(candidate(prepared, mass, 0.0, 0.99, value=10.9), 0)
    assert explains(candidate(prepared, mass, 0.0, 0.99, value=11.1), 0)


@pytest.mark.slow
def test_a_constant_within_three_standard_deviations_is_doubted(diagnosis):
    (found,) = diagnosis.effects
    (angle,) = found.parameters.values()
    near: Any = dataclasses.replace(found, declared=angle.value + 2.9 * angle.std)
    assert doubted([near], {found.name: ("braid_angle",)}).keys() == {found.name}
    assert doubted([found], {found.name: ("braid_angle",)}) == {}
    unsure = dataclasses.replace(found, declared_std=0.5 * ANGLE)
    # A wrong value of the card is no strength that a machine may have or not.
    assert beyond_machines([found], {found.name: ("braid_angle",)}, {found.name: 1e-6}) == {}
    assert doubted([unsure], {found.name: ("braid_angle",)}).keys() == {found.name}


@pytest.mark.slow
def test_nothing_is_tried_where_the_card_is_not_to_be_doubted():
    recording = driven_recording({}, driven_card({}, braid_angle=1.2 * ANGLE), seed=3, seconds=8.0)
    found = jm.diagnose(recording, catalogue=(), constants=False)
    assert found.effects == () and found.rounds == ()


def test_constants_are_of_one_kind():
    mass = CardConstant("mass", "mass", 8.0, None, 1.0, 100.0, "mass that is lifted")
    assert (mass.name, mass.kind, mass.column, mass.within(0.1)) == ("constant:mass", mass.name, None, 1.0)
