"""From a recording to the effect that its model lacks, end to end."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.diagnose import diagnose
from jaxmuscle.diagnosis.evidence import (
    LARGEST_P,
    LEAST_GAIN,
    LIKELIHOOD_RATIO,
    SIGN_FLIPS,
    Evidence,
    gain,
    typical_fall,
)
from jaxmuscle.diagnosis.ranking import Candidate, Ranking
from jaxmuscle.effects import ChamberLeak, LoadFriction, PressureDependentEnds
from jaxmuscle.effects.sensors import AbstractSensorLag
from jaxmuscle.parameters import parameters
from jaxmuscle.report.doubts import doubts
from jaxmuscle.signals import FORCE_READING

MASS_FRICTION = 13.84
"""Guide friction with which the bench made the shipped recording [N]."""


@pytest.fixture(scope="module")
def lift():
    messages = []
    diagnosis = diagnose(jm.read(jm.sample("lift")), progress=messages.append)
    return diagnosis, messages


@pytest.mark.slow
def test_lift_lacks_load_friction(lift):
    diagnosis, _ = lift
    assert diagnosis.verdict == "effects found"
    assert diagnosis.converged
    first = diagnosis.effects[0]
    assert (first.name, first.signal) == ("load_friction", "load")
    assert first.p_value < LARGEST_P[SIGN_FLIPS]
    assert LEAST_GAIN[SIGN_FLIPS] < first.gain <= 1.0


@pytest.mark.slow
def test_lift_strength(lift):
    force = lift[0].effects[0].parameters["force"]
    assert force.unit == "N"
    assert force.value == pytest.approx(MASS_FRICTION, rel=0.05)
    assert abs(force.value - MASS_FRICTION) < 4 * force.std
    assert force.std < 0.05 * MASS_FRICTION


@pytest.mark.slow
def test_lift_held_out_error_falls_to_the_noise(lift):
    diagnosis, _ = lift
    before, after = (part["held_out"]["position"] for part in (diagnosis.before, diagnosis.after))
    assert before.in_noise > 1.7
    assert after.in_noise < 1.5
    assert after.rmse == pytest.approx(after.in_noise * diagnosis.noise["position"])
    assert diagnosis.held_out_fraction == pytest.approx(0.3, abs=1e-3)


@pytest.mark.slow
def test_lift_errors_are_those_of_its_traces(lift):
    traces, after = lift[0].traces, lift[0].after
    for part, rows in (("training", ~traces.held_out), ("held_out", traces.held_out)):
        error = (traces.after["position"] - traces.measured["position"])[rows]
        assert after[part]["position"].rmse == pytest.approx(np.sqrt(np.mean(error**2)))


@pytest.mark.slow
def test_lift_model_differs_by_what_was_found(lift):
    diagnosis, _ = lift
    assert set(diagnosis.declared.effects) == {"thread_friction"}
    assert set(diagnosis.model.effects) == {"thread_friction", *(e.name for e in diagnosis.effects)}
    entries = parameters(diagnosis.model)
    given = diagnosis.effects[0].parameters["force"].value
    assert float(entries["effects.load_friction.force"].value) == given
    assert diagnosis.parameters["effects.load_friction.force"].value == given
    assert set(diagnosis.parameters) == set(diagnosis.correlations.index)
    assert {"valve_area", "end_factor"} < set(diagnosis.parameters)


@pytest.mark.slow
def test_lift_runners_up(lift):
    """Every other effect of the rig, best first, and none of them as good."""
    diagnosis, messages = lift
    names = [alternative.name for alternative in diagnosis.alternatives]
    offered = {effect.name for effect in bench.sought("isotonic")}
    assert set(names) == offered - {"thread_friction", "load_friction"}
    judged = [alternative.judged for alternative in diagnosis.alternatives]
    assert judged == sorted(judged, reverse=True), "those that were tried on unseen windows come first"
    losses = [alternative.loss for alternative in diagnosis.alternatives if alternative.judged]
    assert len(losses) > 1 and losses == sorted(losses)
    assert losses[0] > diagnosis.rounds[0].ranking[0].loss
    assert all(alternative.told_apart for alternative in diagnosis.alternatives)
    assert any("load_friction" in str(message) for message in messages)


@pytest.mark.slow
def test_nothing_is_missing():
    diagnosis = diagnose(
        driven_recording({"thread_friction": bench.THREADS}, driven_card(bench.THREADS), seed=3)
    )
    assert (diagnosis.verdict, diagnosis.effects, diagnosis.unexplained) == ("complete", (), ())
    assert diagnosis.converged
    for part in ("training", "held_out"):
        assert diagnosis.before[part] == diagnosis.after[part]
    for name, value in {"initial_radius": 0.007, "end_factor": 1.303}.items():
        estimate = diagnosis.parameters[name]
        assert abs(estimate.value - value) < 4 * estimate.std


@pytest.mark.slow
def test_ends_of_the_muscle_are_found():
    effects = {"thread_friction": bench.THREADS, "pressure_dependent_ends": {"amplitude": 0.8}}
    diagnosis = diagnose(driven_recording(effects, driven_card(bench.THREADS), seed=5))
    assert diagnosis.verdict == "effects found"
    first = diagnosis.effects[0]
    assert first.name == "pressure_dependent_ends"
    assert first.parameters["amplitude"].value == pytest.approx(0.8, rel=0.05)
    assert diagnosis.after["held_out"]["force"].rmse < 0.5 * diagnosis.before["held_out"]["force"].rmse
    reveal = diagnosis.reveal
    assert reveal is not None
    assert (reveal.signal, reveal.unit) == ("muscle_force", "N")
    assert np.std(reveal.after) < 0.5 * np.std(reveal.before)


@pytest.mark.slow
def test_what_the_catalogue_does_not_hold_is_unexplained():
    """A force that ripples along the contraction, and an empty catalogue."""
    contraction = driven_recording({}, driven_card({})).columns["position"]
    extra = 8.0 * np.sin(contraction / 0.004)
    diagnosis = diagnose(driven_recording({}, driven_card({}), extra=extra), catalogue=())
    assert (diagnosis.verdict, diagnosis.effects) == ("unexplained", ())
    (left,) = diagnosis.unexplained
    assert left.signal == "muscle_force"
    assert left.depends_on[0] == "position"
    assert left.rms_in_noise > 3


class WithoutNumbers(AbstractSensorLag):
    """A lag of the force whose reading is no number after the first step, as of a fault in an own effect."""

    name: ClassVar = "without_numbers"
    slot: ClassVar = FORCE_READING
    reads: ClassVar = frozenset({"force"})
    strength: ClassVar = "time_constant"
    starts: ClassVar = ({},)
    source: ClassVar = "none"

    def lagging(self, signals):
        return signals.force

    def update(self, memory, signals, step):
        error, value = super().update(memory, signals, step)
        return error + (0.0 * step) / (0.0 * step), value


@pytest.mark.slow
def test_a_candidate_without_numbers_is_told_and_hides_no_other():
    recording = driven_recording({"pressure_dependent_ends": {"amplitude": 0.8}}, driven_card({}), seed=5)
    diagnosis = diagnose(recording, catalogue=(PressureDependentEnds, WithoutNumbers), constants=False)
    assert [effect.name for effect in diagnosis.effects] == ["pressure_dependent_ends"]
    assert {a.name for each in diagnosis.rounds for a in each.ranking if a.failed} == {"without_numbers"}
    assert any(each.startswith("Without numbers could not be tried") for each in doubts(diagnosis))


@pytest.mark.slow
def test_held_out_rows_do_not_influence_the_outcome():
    recording = jm.read(jm.sample("lift"))
    tried: Any = {"catalogue": (LoadFriction, ChamberLeak), "constants": False}
    clean = diagnose(recording, **tried)
    first, rng = round(0.7 * len(recording)), np.random.default_rng(1)
    columns = {name: values.copy() for name, values in recording.columns.items()}
    for name in ("pressure", "position"):
        columns[name][first:] += 0.1 * np.ptp(columns[name]) * rng.normal(size=len(recording) - first)
    spoilt = diagnose(dataclasses.replace(recording, columns=columns), **tried)
    names = [[effect.name for effect in found.effects] for found in (clean, spoilt)]
    assert names == [["load_friction"]] * 2
    assert spoilt.after["held_out"]["position"].rmse > 5 * clean.after["held_out"]["position"].rmse
    for name, estimate in clean.parameters.items():
        assert spoilt.parameters[name].value == pytest.approx(estimate.value, rel=1e-9), name


@pytest.mark.slow
def test_a_practice_recording(shared):
    """The other ones are in `benchmarks/diagnosis.py`: some take minutes."""
    diagnosis = diagnose(jm.read(shared / "recordings" / "practice" / "08.csv"))
    assert [effect.name for effect in diagnosis.effects] == ["bladder_stiffness"]


@pytest.mark.parametrize(
    ("loss", "gain", "p_value", "found", "accepted"),
    [
        (1.5, 0.15, 0.009, 0, True),
        (1.5, 0.04, 1e-6, 0, False),
        (1.5, 0.9, 0.011, 0, False),
        # Every further effect is another chance to be misled.
        (1.5, 0.15, 0.004, 1, True),
        (1.5, 0.15, 0.006, 1, False),
        (1.5, 0.15, 0.003, 2, False),
    ],
)
def test_what_supports_an_effect(loss, gain, p_value, found, accepted):
    def candidate(gain, p_value):
        return Candidate((LoadFriction,), Evidence(gain, p_value, loss), np.zeros((1, 1)), None, ())  # pyright: ignore

    best = candidate(gain, p_value)
    ranking = Ranking(loss, (), (best, candidate(0.0, 1.0)), 1)
    assert ranking.supported(found) is (best if accepted else None)


@pytest.mark.parametrize(
    ("gain", "p_value", "enough"), [(0.4, 1e-5, True), (0.4, 1e-3, False), (0.2, 0.0, False)]
)
def test_a_likelihood_ratio_has_to_be_clearer(gain, p_value, enough):
    assert Evidence(gain, p_value, 1.0, 4, LIKELIHOOD_RATIO).supports(0) is enough


def test_stretches_that_are_too_few_for_any_outcome():
    """Ten times 2^-10 is below a hundredth, ten times 2^-9 is not; every further effect needs one more."""
    assert [Evidence(0.5, 0.1, 1.0, n).too_few_stretches(0) for n in (9, 10)] == [True, False]
    assert [Evidence(0.5, 0.1, 1.0, n).too_few_stretches(1) for n in (10, 11)] == [True, False]


def test_more_stretches_are_needed_where_a_p_value_is_multiplied():
    """By the 64 pairs that were tried, say: six stretches more."""
    assert [Evidence(0.5, 0.1, 1.0, n).too_few_stretches(0, 64) for n in (15, 16)] == [True, False]


def test_halving_a_large_error_is_enough_whatever_part_of_its_logarithm_that_is():
    """From 100 to 50 noise units the loss, a logarithm of a square, falls by 0.15 of itself only."""
    before, after = (np.full((1, 20), np.log1p(size**2)) for size in (100.0, 49.0))
    halved, less = typical_fall(before, after), typical_fall(before, np.full((1, 20), np.log1p(60.0**2)))
    assert gain(before, after) < 0.2

    def supported(p_value, fall):
        return Evidence(0.15, p_value, 1.0, 4, LIKELIHOOD_RATIO, fall).supports(0)

    assert supported(1e-6, halved) and not supported(1e-6, less) and not supported(1e-3, halved)


def test_the_best_candidate_or_none():
    """A runner-up whose p-value is small enough does not take the place of a best one without support."""

    def candidate(p_value):
        return Candidate((LoadFriction,), Evidence(0.2, p_value, 1.0), np.zeros((1, 12)), None, ())  # pyright: ignore

    assert Ranking(5.0, (), (candidate(0.013), candidate(0.009)), 1).supported(0) is None


def test_nothing_to_choose_from_supports_nothing():
    assert Ranking(5.0, (), (), 1).supported(0) is None
