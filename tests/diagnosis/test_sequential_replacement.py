"""An effect that was added first, tried once more against others beside the one that was added after it."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.diagnosis_data import Alternative, Round
from jaxmuscle.diagnosis.evidence import SIGN_FLIPS, Evidence
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.ranking import Candidate, Ranking, rank
from jaxmuscle.diagnosis.sequential_replacement import MOST, others_for_its_place
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import BladderStiffness, ForceDrift, reading_effect
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get
from jaxmuscle.progress import Meter
from jaxmuscle.report.page import _search

OFFSET = reading_effect("sensor_offset", "pressure")
STIFF = {"stiffness": 80.0, "threshold_pressure": 2.8e4}
DRIFT = {"share": 0.038, "time_constant": 6.5}


def added_in_turn(first, effects):
    """A search in which `first` was added, and then a drift of the force, on readings of the oracle."""
    prepared = case(driven_recording(effects, driven_card({}), seed=2), 0.3, None)
    kinds = missing(prepared.actuator, (BladderStiffness, OFFSET, ForceDrift))
    bench, meter = workbench(prepared, kinds), Meter(lambda progress: None)
    selection = forward_selection(prepared, bench, meter)
    ranking = rank(bench, selection.model, [], kinds, selection.parts, meter)
    added = next(each for each in ranking.candidates if each.name == first)
    rest = tuple(each for each in ranking.candidates if each is not added)
    selection._add(added)
    selection.rankings[first] = Ranking(ranking.loss, ranking.folds, (added, *rest), ranking.stretch)
    drift = rank(bench, selection.model, [first], [ForceDrift], selection.parts, meter)
    selection._add(drift.candidates[0])
    selection._replace_earlier()
    return selection


@pytest.mark.slow
def test_an_offset_that_was_taken_for_the_bladder_goes_once_the_drift_is_there():
    found = added_in_turn("sensor_offset_pressure", {"bladder_stiffness": STIFF, "force_drift": DRIFT})
    assert found.names == ["bladder_stiffness", "force_drift"]
    assert found.rounds[-1].added == "bladder_stiffness" and found.rounds[-1].beside == ("force_drift",)
    alternatives = {each.name: each for each in found.rounds[-1].ranking}
    assert alternatives["sensor_offset_pressure"].told_apart
    threshold = get(found.model, "effects.bladder_stiffness.threshold_pressure")
    assert float(threshold) == pytest.approx(STIFF["threshold_pressure"], rel=0.05)


@pytest.mark.slow
def test_the_right_one_stays_and_is_told_apart():
    found = added_in_turn("bladder_stiffness", {"bladder_stiffness": STIFF, "force_drift": DRIFT})
    assert found.names == ["bladder_stiffness", "force_drift"]
    first, *others = found.rounds[-1].ranking
    assert first.name == found.rounds[-1].added == "bladder_stiffness"
    assert [each.name for each in others if each.told_apart] == ["sensor_offset_pressure"]


def candidate(name, loss, judged=True):
    effect: Any = SimpleNamespace(name=name)
    losses = loss + 0.1 * np.sin(np.arange(40.0))[None]
    folds: Any = (None,) if judged else ()
    model: Any = None
    return Candidate((effect,), Evidence(0.5, 1e-4, loss), losses, model, folds)


def test_only_those_are_tried_that_were_judged_and_did_as_well_alone():
    others = [candidate("worse", 2.0), candidate("not_judged", 1.0, judged=False), candidate("later", 1.0)]
    alike = [candidate(f"alike_{number}", 1.0) for number in range(MOST + 1)]
    ranking = Ranking(5.0, (), (candidate("added", 1.0), *others, *alike), 1)
    tried = others_for_its_place(ranking, ["added", "later"], something_is_left=False)
    assert [effect.name for effect in tried] == [each.name for each in alike[:MOST]]


def test_where_something_is_left_those_that_did_worse_alone_are_tried_too_if_they_were_supported():
    unsupported = dataclasses.replace(candidate("unsupported", 2.0), evidence=Evidence(0.5, 0.3, 2.0))
    others = [candidate("alike", 1.0), candidate("not_judged", 1.5, judged=False), unsupported]
    ranking = Ranking(5.0, (), (candidate("added", 1.0), *others, candidate("worse", 2.0)), 1)
    tried = [others_for_its_place(ranking, ["added"], left) for left in (False, True)]
    assert [[effect.name for effect in each] for each in tried] == [["alike"], ["alike", "worse"]]


def without_need(first, effects):
    """A search in which `first` and then the bladder were added, after what is not needed was taken out."""
    prepared = case(driven_recording(effects, driven_card({}), seed=2), 0.3, None)
    kinds = missing(prepared.actuator, (BladderStiffness, ForceDrift))
    bench, meter = workbench(prepared, kinds), Meter(lambda progress: None)
    selection = forward_selection(prepared, bench, meter)
    accepted: list[str] = []
    for effect in (first, BladderStiffness):
        ranking = rank(bench, selection.model, accepted, [effect], selection.parts, meter)
        selection._add(ranking.candidates[0])
        selection.rankings[effect.name] = ranking
        accepted.append(effect.name)
    selection._remove_unneeded()
    return selection


@pytest.mark.slow
def test_what_is_not_needed_beside_a_later_effect_is_taken_out_again():
    found = without_need(ForceDrift, {"bladder_stiffness": STIFF})
    assert found.names == ["bladder_stiffness"] and found.removed == {"force_drift"}
    last = found.rounds[-1]
    assert last.added is None and last.beside == ("bladder_stiffness",)
    assert [each.name for each in last.ranking] == ["force_drift"]
    assert "force_drift" not in found.model.effects and found.before is None
    assert float(get(found.model, "effects.bladder_stiffness.stiffness")) == pytest.approx(80.0, rel=0.05)


@pytest.mark.slow
def test_what_is_needed_stays():
    found = without_need(ForceDrift, {"bladder_stiffness": STIFF, "force_drift": DRIFT})
    assert found.names == ["force_drift", "bladder_stiffness"] and not found.removed


def test_the_report_says_that_an_effect_is_not_needed_any_more():
    alternative = Alternative("creep", "force", 0.01, 0.4, 1.0, False, True, SIGN_FLIPS, 20, False)
    search = Round(1.1, (alternative,), None, beside=("backlash",))
    diagnosis: Any = SimpleNamespace(rounds=(search, search))
    assert _search(diagnosis, 1)["outcome"] == (
        "Search 2: once more beside backlash: creep is not needed any more."
    )
