"""Recordings of one bench whose cards give different values: another weight, a muscle of another length."""

import dataclasses
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven
from oracles.recorded import NOISE, driven_card, driven_recording, smooth_motion

import jaxmuscle as jm
from jaxmuscle.actuators import Isotonic
from jaxmuscle.diagnosis.card_constants import card_constants
from jaxmuscle.diagnosis.diagnosis_files import load
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.fingerprint import origin
from jaxmuscle.estimation.missing_data import beyond_stops
from jaxmuscle.estimation.residuals import values_and_slopes
from jaxmuscle.parameters import get, raised, replace
from jaxmuscle.recordings.card import actuator_from_card
from jaxmuscle.recordings.joining import joined, of_one_bench
from jaxmuscle.report.page import page
from jaxmuscle.report.report_files import fitted_card, result
from jaxmuscle.report.sentence import sentence
from jaxmuscle.report.tables import differing, where
from jaxmuscle.simulation.observed import observed
from jaxmuscle.simulation.track import command_before, machine_at, start_at_rest

MASSES = (8.0, 3.0, 11.0)
LENGTHS = (bench.CARDS["driven"]["initial_length"], 0.24)


@pytest.fixture(scope="module")
def lift():
    return jm.read(jm.sample("lift"))


def with_mass(recording, mass, name=None, std=None):
    card = recording.card.updated({"mass": (mass, std)})
    return dataclasses.replace(recording, card=card, name=name or f"{mass:g} kg")


@pytest.fixture(scope="module")
def parts(lift):
    """Three stretches of a lift, as if each had another weight."""
    return [
        with_mass(lift.part(first, first + 300), mass)
        for first, mass in zip((0, 1000, 2000), MASSES, strict=True)
    ]


@pytest.fixture(scope="module")
def whole(parts):
    return of_one_bench(parts)


def test_the_card_is_the_first_ones_and_the_differences_are_from_it(whole):
    assert whole.card.quantities["mass"].value == MASSES[0]
    np.testing.assert_array_equal(
        whole.differences["mass"], np.repeat(np.array(MASSES) - MASSES[0], 300), strict=True
    )
    assert [whole.differing(member) for member in whole.members] == [{"mass": mass} for mass in MASSES]
    assert "<td>8.000 kg, 3.000 kg, 11.00 kg</td>" in whole._repr_html_()


def test_equal_values_make_no_difference(parts):
    alike = of_one_bench([parts[0], dataclasses.replace(parts[0], name="again")])
    assert alike.differences == {} and alike.differing(alike.members[0]) == {}


def test_parts_and_joints_keep_the_differences(whole, parts):
    np.testing.assert_array_equal(
        whole.part(250, 650).differences["mass"], np.repeat([0.0, -5.0, 3.0], [50, 300, 50])
    )
    second = whole.part(300, 600)
    assert second.differing(second.members[0]) == {"mass": 3.0}
    behind = joined([parts[1], whole], "all")
    np.testing.assert_array_equal(behind.differences["mass"], np.repeat([0.0, 5.0, 0.0, 8.0], 300))
    assert [behind.differing(member)["mass"] for member in behind.members] == [3.0, *MASSES]


def test_a_machine_without_what_differs_is_refused(whole):
    actuator = jm.actuator(whole.card)

    class WithoutMass(Isotonic):
        rig: ClassVar = "without-mass"
        quantities: ClassVar = {n: path for n, path in Isotonic.quantities.items() if n != "mass"}

    fields = {field.name: getattr(actuator, field.name) for field in dataclasses.fields(actuator)}
    with pytest.raises(InputError, match="differ in mass, and rig 'without-mass' has no such quantity"):
        jm.simulate(WithoutMass(**fields), whole)


def test_what_else_differs_is_refused(lift):
    sure, unsure = with_mass(lift, 8.0), with_mass(lift, 9.0, std=0.2)
    with pytest.raises(InputError, match=r"differ in \[known\] mass; .* values may differ"):
        of_one_bench([sure, unsure])
    with pytest.raises(InputError, match=r"differ in \[uncertain\] mass"):
        of_one_bench([unsure, with_mass(lift, 8.0, std=0.1)])
    rubbing = dataclasses.replace(lift, card=lift.card.updated({}, {"load_friction": {"force": (3.0, 1.0)}}))
    with pytest.raises(InputError, match=r"differ in \[effects\]"):
        of_one_bench([sure, rubbing])
    predicting = dataclasses.replace(lift, card=dataclasses.replace(lift.card, state_from="past"))
    with pytest.raises(InputError, match=r"differ in .*state_from"):
        of_one_bench([sure, predicting])
    assert of_one_bench([unsure, with_mass(lift, 8.0, std=0.2)]).differences["mass"][-1] == -1.0


def test_it_is_simulated_as_each_by_itself(whole, parts):
    together = jm.simulate(actuator_from_card(whole.card), whole).readings
    for member, part in zip(whole.members, parts, strict=True):
        alone = jm.simulate(actuator_from_card(part.card), part).readings
        for column, values in alone.items():
            rows = slice(member.first, member.first + member.rows)
            np.testing.assert_allclose(together[column][rows], values, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_it_goes_on_from_a_state_with_a_late_command(whole):
    delay = bench.built(jm.effects.CommandDelay, 0.011)
    machine = actuator_from_card(whole.card).with_effects(command_delay=delay)
    once = jm.simulate(machine, whole.part(0, 600)).readings
    first = jm.simulate(machine, whole.part(0, 450))
    second = jm.simulate(machine, whole.part(450, 600), start=first.final).readings
    for column, values in once.items():
        np.testing.assert_allclose(second[column], values[450:], rtol=1e-9, atol=1e-12)


def test_without_differences_the_machine_is_the_same_object(lift):
    machine = actuator_from_card(lift.card)
    assert machine_at(machine, observed(machine, lift, {}).track, 5) is machine
    assert raised(machine, {}) is machine


@pytest.mark.slow
def test_it_rests_under_the_weight_of_its_own(whole, parts):
    machine = actuator_from_card(whole.card)
    track = observed(machine, whole, {}).track
    for first, part in zip((0, 300, 600), parts, strict=True):
        own = actuator_from_card(part.card)
        alone = observed(own, part, {}).track
        for name, value in start_at_rest(own, alone).state.items():
            if name != "effects":
                np.testing.assert_allclose(
                    start_at_rest(machine, track, first).state[name], value, rtol=1e-12
                )
        np.testing.assert_allclose(
            command_before(machine, track, first), command_before(own, alone, 0), rtol=1e-12
        )


@pytest.mark.slow
def test_slopes_are_those_of_differences_of_residuals(whole):
    ready = case(whole, 0.0)
    machine, paths = ready.actuator, ("mass", "valve.area")
    point = np.array([float(get(machine, path)) for path in paths])
    values, slopes = values_and_slopes(jnp.asarray(point[None]), machine, ready.problem, paths)
    assert np.isfinite(values).all() and np.isfinite(slopes).all()
    for i, step in enumerate(1e-5 * np.diag(point)):
        sides = [
            values_and_slopes(jnp.asarray((point + sign * step)[None]), machine, ready.problem, paths)[0][0]
            for sign in (1, -1)
        ]
        quotient = np.asarray(sides[0] - sides[1]) / (2 * step.sum())
        np.testing.assert_allclose(slopes[0, i], quotient, rtol=1e-3, atol=1e-4 * np.abs(quotient).max())


def test_slopes_under_vmap_and_at_rest(whole):
    machine = actuator_from_card(whole.card)
    track = observed(machine, whole, {}).track

    def load(mass, row):
        return get(machine_at(replace(machine, {"mass": mass}), track, row), "mass")

    rows = jnp.array([0, 299, 300, 899, 5000])
    np.testing.assert_allclose(jax.vmap(load, (None, 0))(8.0, rows), [8.0, 8.0, 3.0, 11.0, 11.0])
    np.testing.assert_allclose(jax.vmap(jax.grad(load), (None, 0))(8.0, rows), np.ones(5))


def test_a_wrong_constant_is_within_the_range_of_machines_in_all(whole, lift):
    (alone,) = (each for each in card_constants(case(lift.part(0, 600), 0.3)) if each.quantity == "mass")
    (here,) = (each for each in card_constants(case(whole, 0.3)) if each.quantity == "mass")
    assert here.lower == pytest.approx(alone.lower + 5.0)  # that of 3 kg is then as light as may be
    assert here.upper == pytest.approx(alone.upper - 3.0)


def test_the_ends_of_a_machine_are_those_of_its_length():
    swing = jm.read(jm.sample("swing")).part(0, 200)
    machine = actuator_from_card(swing.card)
    ends = machine.stops["angle"]
    assert "initial_contraction" in swing.card.quantities
    less = swing.card.quantities["initial_contraction"].value / 2
    card = swing.card.updated(
        {"initial_contraction": (less, swing.card.quantities["initial_contraction"].std)}
    )
    short = dataclasses.replace(swing, card=card, name="short")
    beyond = {"angle": np.full(200, 0.9 * np.asarray(ends[1]).item())}
    wide, narrow = (dataclasses.replace(each, columns={**each.columns, **beyond}) for each in (swing, short))
    assert beyond_stops(machine, wide) == {}
    rows = beyond_stops(machine, of_one_bench([wide, narrow]))["angle"]
    np.testing.assert_array_equal(rows, np.repeat([False, True], 200))


def test_a_model_is_told_as_it_was_fitted(whole):
    machine = replace(actuator_from_card(whole.card), {"mass": 8.25})
    member = whole.members[1]
    assert differing(whole, member) == "mass 3.000 kg"
    assert differing(whole, member, machine) == "mass 3.250 kg"
    assert where(whole, "mass") == "in 8 kg; in the others as far off"
    assert where(whole, "valve_area") == ""


def test_other_differences_are_another_diagnosis(parts):
    heavier = [parts[0], with_mass(parts[1], 3.5), parts[2]]
    prints = [origin([of_one_bench(each)], [], ()) for each in (parts, heavier)]
    assert prints[0]["recording"] != prints[1]["recording"]


def two_lengths(declared):
    """Forces of two muscles by the page of equations, with cards that know nothing of thread friction."""
    first = driven_recording({"thread_friction": bench.THREADS}, driven_card(declared), seconds=8.0, seed=1)
    motion = smooth_motion(8.0)
    other = {**bench.CARDS["driven"], "initial_length": LENGTHS[1]}
    noise = NOISE * np.random.default_rng(2).normal(size=len(first))
    force = driven(other, {"thread_friction": bench.THREADS}, *motion) + noise
    second = dataclasses.replace(
        first,
        name="long",
        card=driven_card(declared, initial_length=LENGTHS[1]),
        columns={**first.columns, "force": force},
    )
    return [dataclasses.replace(first, name="short"), second]


@pytest.fixture(scope="module")
def diagnosis():
    return jm.diagnose(two_lengths({}))


@pytest.mark.slow
def test_two_lengths_are_diagnosed_together(diagnosis, tmp_path):
    assert diagnosis.verdict == "effects found"
    assert [effect.name for effect in diagnosis.effects] == ["thread_friction"]
    assert diagnosis.after["held_out"]["force"].in_noise < 1.1
    told = result(diagnosis)["recordings"]
    assert [each["values"] for each in told] == [{"initial_length": length} for length in LENGTHS]
    assert "initial length 0.2400 m" in page(diagnosis)
    assert "initial length 0.2400 m in long" in fitted_card(diagnosis).description
    again = load(diagnosis.save(tmp_path / "two.json"), Diagnosis)
    np.testing.assert_array_equal(
        again.recording.differences["initial_length"], diagnosis.recording.differences["initial_length"]
    )
    assert sentence(again) == sentence(diagnosis)


@pytest.mark.slow
def test_a_fit_of_the_whole_finds_what_both_have():
    short, long = two_lengths({"static_coefficient": 0.02, "kinetic_coefficient": 0.05})
    whole = of_one_bench([short, long])
    paths = [f"effects.thread_friction.{name}" for name in ("static_coefficient", "kinetic_coefficient")]
    machine = actuator_from_card(whole.card)
    machine = replace(
        machine, {"effects.thread_friction.velocity_constant": bench.THREADS["velocity_constant"]}
    )
    fit = jm.fit(machine, whole, paths, starts=1, priors=dict.fromkeys(paths))
    for path in paths:
        found, true = fit.parameters[path], bench.THREADS[path.rsplit(".", 1)[1]]
        assert abs(found.value - true) < 4 * found.std and found.std < 0.1 * true
    # As if both had the length of the first one.
    fixed = dataclasses.replace(whole, differences={})
    assert jm.fit(machine, fixed, paths, starts=1, priors=dict.fromkeys(paths)).cost > 10 * fit.cost
