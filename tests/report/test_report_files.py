"""The files of a diagnosis.

The mapping that becomes result.json.
"""

import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from effects.own import Sleeve
from report.fake import diagnosis

from jaxmuscle.diagnosis.diagnosis_data import Estimate, Pattern
from jaxmuscle.diagnosis.result import Diagnosis
from jaxmuscle.effects import BY_NAME, register
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card, actuator_from_card
from jaxmuscle.recordings.joining import joined
from jaxmuscle.report import report_files as module
from jaxmuscle.report.page import page
from jaxmuscle.report.report_files import fitted_card, result, write


@pytest.mark.slow
def test_three_files(tmp_path: Path) -> None:
    outcome, folder = diagnosis("effects found"), tmp_path / "new" / "out"
    files = write(outcome, folder)
    assert sorted(p.name for p in folder.iterdir()) == ["card.toml", "report.html", "result.json"]
    assert {p.name for p in files} == {"card.toml", "report.html", "result.json"}
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == result(outcome)
    assert (folder / "report.html").read_text(encoding="utf-8") == page(outcome)


@pytest.mark.slow
def test_a_diagnosis_writes_them_itself(tmp_path: Path) -> None:
    outcome = diagnosis("effects found")
    files = outcome.report(tmp_path / "own")
    assert [(p.name, p.read_bytes()) for p in files] == [
        (p.name, p.read_bytes()) for p in write(outcome, tmp_path / "out")
    ]
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="is not a folder"):
        outcome.report(tmp_path / "taken")


def test_no_report(tmp_path: Path) -> None:
    write(diagnosis("complete"), tmp_path, report=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["card.toml", "result.json"]


def test_card_reads_back_with_the_fitted_values_and_the_added_effect(tmp_path: Path) -> None:
    outcome = diagnosis("effects found")
    write(outcome, tmp_path)
    card = Card.read(tmp_path / "card.toml")
    assert (card.uncertain["valve_area"].value, card.uncertain["valve_area"].std) == (1.1712e-6, 3.1e-9)
    assert (card.effects["load_friction"]["force"].value, card.effects["load_friction"]["force"].std) == (
        16.21,
        0.38,
    )
    assert card.effects["thread_friction"]["kinetic_coefficient"].value == 0.0893
    declared = outcome.recording.card
    assert (
        card.effects["thread_friction"]["static_coefficient"]
        == declared.effects["thread_friction"]["static_coefficient"]
    )
    assert (card.known, card.columns, card.noise) == (declared.known, declared.columns, declared.noise)


def test_the_written_card_keeps_the_comments_of_the_one_that_was_read(tmp_path: Path) -> None:
    outcome = diagnosis("effects found")
    text = (outcome.recording.card.text or "").replace("[uncertain]\n", "[uncertain]  # by hand\n# a guess\n")
    recording = dataclasses.replace(outcome.recording, card=Card.from_toml(text))
    write(dataclasses.replace(outcome, recording=recording), tmp_path, report=False)
    written = (tmp_path / "card.toml").read_text(encoding="utf-8")
    assert "[uncertain]  # by hand\n# a guess\nvalve_area = { value = 1.1712, std = 0.0031" in written
    assert written.startswith(text[: text.index("[uncertain]")])


def test_a_value_without_a_usable_deviation_becomes_known(tmp_path: Path) -> None:
    fitted = {"end_factor": Estimate(1.3, math.inf, "", "")}
    write(dataclasses.replace(diagnosis("complete"), parameters=fitted), tmp_path, report=False)
    card = Card.read(tmp_path / "card.toml")
    assert card.known["end_factor"].value == 1.3 and "end_factor" not in card.uncertain


@pytest.fixture
def own() -> Iterator[Diagnosis]:
    """An outcome that added an effect of the user's own; effects registered by a test are forgotten."""
    found, known = diagnosis("effects found"), dict(BY_NAME)
    estimate = Estimate(1.6e4, 40.0, "N/m^2", "force per contraction squared")
    effect = dataclasses.replace(
        found.effects[0], name="own_sleeve", signal="muscle_force", parameters={"stiffness": estimate}
    )
    search = found.rounds[0]
    ranking = (dataclasses.replace(search.ranking[0], name="own_sleeve"), *search.ranking[1:])
    parameters = {k: v for k, v in found.parameters.items() if "load_friction" not in k}
    names = [*parameters, "effects.own_sleeve.stiffness"]
    table = found.correlations.set_axis(names).set_axis(names, axis=1)
    sleeve = Sleeve(stiffness=1.6e4)  # pyright: ignore
    yield dataclasses.replace(
        found,
        effects=(effect,),
        rounds=(dataclasses.replace(search, ranking=ranking, added="own_sleeve"), *found.rounds[1:]),
        model=found.model.without_effects("load_friction").with_effects(own_sleeve=sleeve),
        parameters={**parameters, "effects.own_sleeve.stiffness": estimate},
        correlations=table,
    )
    BY_NAME.clear()
    BY_NAME.update(known)


def test_an_effect_of_ones_own_is_reported_and_told_in_the_card(own: Diagnosis, tmp_path: Path) -> None:
    assert {p.name for p in write(own, tmp_path)} == {"card.toml", "report.html", "result.json"}
    card = Card.read(tmp_path / "card.toml")
    assert "not part of this card: effects.own_sleeve.stiffness = 16000.0 N/m^2." in card.description
    assert "own_sleeve" not in card.effects
    assert card.uncertain["valve_area"].value == 1.1712e-6
    assert "own sleeve" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_registered_effect_of_ones_own_is_part_of_the_card(own: Diagnosis, tmp_path: Path) -> None:
    register(Sleeve)
    write(own, tmp_path, report=False)
    card = Card.read(tmp_path / "card.toml")
    stiffness = card.effects["own_sleeve"]["stiffness"]
    assert (stiffness.value, stiffness.std) == (1.6e4, 40.0)
    assert card.description == own.recording.card.description
    assert actuator_from_card(card).effects["own_sleeve"] == own.model.effects["own_sleeve"]


def test_nothing_is_written_when_rendering_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: object) -> str:
        raise RuntimeError("no page")

    monkeypatch.setattr(module, "page", broken)
    with pytest.raises(RuntimeError, match="no page"):
        write(diagnosis("complete"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_old_files_stay_whole_when_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "result.json").write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match="No space left"):
        write(diagnosis("complete"), tmp_path, report=False)
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]
    assert (tmp_path / "result.json").read_text() == "old"


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="is not a folder"):
        write(diagnosis("complete"), tmp_path / "taken" / "out", report=False)


VERDICTS = ("effects found", "complete", "undecided", "not confirmed", "unexplained")
KEYS = {
    "verdict",
    "effects",
    "unconfirmed",
    "unused_readings",
    "refused",
    "violated_priors",
    "missing_in_noise",
    "alternatives",
    "before",
    "after",
    "noise",
    "horizon",
    "state_from",
    "held_out_fraction",
    "unexplained",
    "parameters",
    "recording",
    "jaxmuscle",
    "seconds",
}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_round_trip_with_the_promised_keys(verdict: str) -> None:
    outcome = result(diagnosis(verdict))
    assert json.loads(json.dumps(outcome, allow_nan=False)) == outcome
    assert set(outcome) == KEYS
    assert outcome["verdict"] == verdict
    assert set(outcome["recording"]) == {"file", "sha256", "rig", "rows"}
    assert outcome["recording"]["file"] == "lift.csv" and outcome["recording"]["rows"] == 6000
    for when in ("before", "after"):
        assert set(outcome[when]) == {"training", "held_out"}
        for columns in outcome[when].values():
            assert set(columns) == {"position", "pressure"}
            assert all(set(error) == {"rmse", "unit", "nrmse"} for error in columns.values())


def test_effects_and_alternatives() -> None:
    outcome = result(diagnosis("effects found"))
    assert outcome["effects"] == [
        {
            "name": "load_friction",
            "signal": "load",
            "parameters": {"force": {"value": 16.21, "std": 0.38, "unit": "N"}},
            "evidence": {"held_out_gain": 0.93, "p_value": 1e-12, "test": "sign flips"},
        }
    ]
    assert outcome["alternatives"][0] == {"name": "load_damping", "held_out_gain": 0.71, "told_apart": True}
    assert "load_friction" not in [other["name"] for other in outcome["alternatives"]]
    assert outcome["unexplained"] == [{"signal": "mass_flow", "share": 0.12, "depends_on": ["pressure"]}]


def test_a_pattern_of_what_is_left() -> None:
    found = diagnosis("unexplained")
    left = dataclasses.replace(found.unexplained[0], pattern=Pattern("drift", "time", None, "s", 0.9))
    (outcome,) = result(dataclasses.replace(found, unexplained=(left,)))["unexplained"]
    assert outcome["pattern"] == {"kind": "drift", "variable": "time", "at": None, "unit": "s", "share": 0.9}


def test_what_is_not_finite_becomes_null() -> None:
    estimate = Estimate(1.3, math.inf, "", "")
    outcome = result(
        dataclasses.replace(diagnosis("complete"), parameters={"end_factor": estimate}, seconds=math.nan)
    )
    assert outcome["parameters"] == {"end_factor": {"value": 1.3, "std": None, "unit": ""}}
    assert outcome["seconds"] is None


def test_what_is_not_confirmed_is_no_effect_of_the_result_and_told_in_the_card() -> None:
    contradicted = diagnosis("not confirmed")
    outcome = result(contradicted)
    assert outcome["effects"] == [] and [e["name"] for e in outcome["unconfirmed"]] == ["load_friction"]
    assert outcome["violated_priors"] == [{"name": "end_factor", "standard_deviations": 4.2}]
    assert "load friction: not confirmed" in fitted_card(contradicted).description


@pytest.mark.slow
def test_several_recordings_are_named_each() -> None:
    outcome = diagnosis("effects found")
    whole = outcome.recording
    second = dataclasses.replace(
        whole.part(2500, None), name="b", file=Path("far", "b.csv"), sha256="abc", breaks=()
    )
    both = joined([whole.part(0, 2500), second], "lift + b")
    said = result(dataclasses.replace(outcome, recording=both))
    held_out = outcome.traces.held_out
    assert said["recordings"] == [
        {
            "name": "lift",
            "file": "lift.csv",
            "sha256": whole.sha256,
            "rows": 2500,
            "held_out_rows": int(held_out[:2500].sum()),
        },
        {
            "name": "b",
            "file": "b.csv",
            "sha256": "abc",
            "rows": 3500,
            "held_out_rows": int(held_out[2500:].sum()),
        },
    ]
    assert (said["recording"]["file"], said["recording"]["sha256"]) == ("lift + b", None)
    assert "recordings" not in result(outcome)
    text = page(dataclasses.replace(outcome, recording=both))
    assert f"b: b.csv, 3500 rows at 500 Hz, {int(held_out[2500:].sum())} of them held out" in text
    assert "on the time axis from 5 s" in text and "abc" in text


def test_a_loaded_diagnosis_of_several_recordings_names_them(tmp_path: Path) -> None:
    outcome = diagnosis("complete")
    both = joined([outcome.recording.part(0, 2500), outcome.recording.part(2500, None)], "both")
    saved = dataclasses.replace(outcome, recording=both).save(tmp_path / "saved.json")
    again = Diagnosis.load(saved).recording
    assert again.joined_from == both.joined_from and again.breaks == both.breaks == (2500,)
