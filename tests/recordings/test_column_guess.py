"""Columns told by names, units and magnitudes, beside the cards that people wrote."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmuscle.actuators import RIGS
from jaxmuscle.recordings import Card
from jaxmuscle.recordings.column_guess import guess_columns, guess_rig
from jaxmuscle.recordings.column_names import column_name
from jaxmuscle.recordings.draft import draft_card
from jaxmuscle.recordings.readers import read_table
from jaxmuscle.recordings.readers.frames import table_of_frame
from jaxmuscle.recordings.table import Table
from jaxmuscle.samples import NAMES, sample

pytestmark = pytest.mark.usefixtures("package_rigs")


def frame(name: str) -> pd.DataFrame:
    return pd.read_csv(sample(name))


def guessed(data: pd.DataFrame, rig: str, units: dict[str, str] | None = None):
    table = table_of_frame("DataFrame", data)
    return guess_columns(Table(table.file, table.columns, 0, units=units or {}), RIGS[rig])


def assert_as_the_card_has_it(file: Path) -> None:
    card, table = Card.read(file.with_suffix(".toml")), read_table(file, file.read_bytes())
    guesses = guess_columns(table, RIGS[card.rig])
    found = {name: (guess.column, guess.unit, guess.reference) for name, guess in guesses.items()}
    assert found == {name: (spec.column, spec.unit, spec.reference) for name, spec in card.columns.items()}
    assert guess_rig(table, RIGS)[0] == card.rig


@pytest.mark.parametrize("name", NAMES)
def test_samples_as_their_cards_have_them(name: str) -> None:
    assert_as_the_card_has_it(sample(name))


def test_practice_recordings_as_their_cards_have_them(shared: Path) -> None:
    files = sorted((shared / "recordings" / "practice").glob("*.csv"))
    assert len(files) >= 17
    for file in files:
        assert_as_the_card_has_it(file)


@pytest.mark.parametrize(
    ("name", "words", "number", "unit", "reference"),
    [
        ("p1_bar", ("p",), 1, "bar", None),
        ("pressure 2 [kPa]", ("pressure",), 2, "kPa", None),
        ("Druck, abs (mbar)", ("druck", "abs"), None, "mbar", "absolute"),
        ("p barg", ("p",), None, "bar", "gauge"),
        ("theta_deg", ("theta",), None, "deg", None),
        ("Winkel [°]", ("winkel",), None, "deg", None),
        ("x/µm", ("x", "u"), None, "um", None),
        ("control/valveCommand.V", ("valve", "command", "control"), None, "V", None),
        ("position in mm", ("position",), None, "mm", None),
        ("time, s", ("time",), None, "s", None),
        ("x", ("x",), None, None, None),
        ("m", ("m",), None, None, None),
        ("F(N)", ("f",), None, "N", None),
    ],
)
def test_names_as_laboratories_write_them(name: str, words, number, unit, reference) -> None:
    found = column_name(name)
    if name == "x/µm":  # A slash also parts a group from its channel.
        assert (found.unit, found.words) == (None, ("m", "x"))
        return
    assert (found.words, found.number, found.unit, found.reference) == (words, number, unit, reference)


def test_what_the_file_says_counts_more_than_the_name() -> None:
    guesses = guessed(frame("lift"), "isotonic", {"p_bar": "kPa(a)", "x_mm": "cm"})
    assert (guesses["pressure"].unit, guesses["pressure"].reference) == ("kPa", "absolute")
    assert guesses["position"].unit == "cm" and guesses["pressure"].sure


BARE = {"lift": ["t", "u", "p", "x"], "bench": ["time", "pressure", "position", "force"]}


@pytest.mark.parametrize(
    ("scales", "units"),
    [
        ((1, 1, 1, 1), ("s", "V", "bar", "mm")),
        ((1e3, 1, 100, 0.001), ("ms", "V", "kPa", "m")),
        ((1e6, 1, 1e5, 1), ("us", "V", "Pa", "mm")),
        ((1, 1, 0.1, 1), ("s", "V", "MPa", "mm")),
        ((1, 1e3, 14.5, 1), ("s", "mV", "psi", "mm")),
    ],
)
def test_units_by_magnitude_are_said_to_be_unsure(scales, units) -> None:
    data = frame("lift").set_axis(BARE["lift"], axis=1) * np.array(scales)
    guesses = guessed(data, "isotonic")
    found = tuple(guess.unit for guess in guesses.values())
    assert found == units
    assert not any(guess.sure for guess in guesses.values())
    assert all("unit by its size" in guess.said[0] for guess in guesses.values())


def test_an_angle_in_radians() -> None:
    data = frame("swing")
    data["theta"] = np.deg2rad(data.pop("theta_deg"))
    guess = guessed(data, "joint")["angle"]
    assert (guess.unit, guess.sure) == ("rad", False)


def test_the_order_of_columns_does_not_matter() -> None:
    for name, rig in (("lift", "isotonic"), ("bench", "driven"), ("swing", "joint")):
        data = frame(name)
        whole = {n: g.column for n, g in guessed(data, rig).items()}
        assert {n: g.column for n, g in guessed(data.iloc[:, ::-1], rig).items()} == whole


def test_columns_that_are_not_asked_for_are_left_alone() -> None:
    data = frame("lift").assign(T_degC=20.0, supply_bar=7.0, remark="ok", index=range(6000))
    found = {name: guess.column for name, guess in guessed(data, "isotonic").items()}
    assert found == dict(zip(found, frame("lift").columns, strict=True))


def test_two_columns_that_may_be_it() -> None:
    data = frame("lift").assign(p_tank_bar=lambda d: d["p_bar"] + 1)
    guess = guessed(data, "isotonic")["pressure"]
    assert guess.column == "p_bar" and not guess.sure and "or is it 'p_tank_bar'?" in guess.said


def test_what_is_not_there_is_not_made_up() -> None:
    guesses = guessed(frame("lift").drop(columns="x_mm"), "isotonic")
    assert guesses["position"].column is None and not guesses["position"].sure
    assert guess_rig(table_of_frame("DataFrame", frame("lift").drop(columns=["valve_V", "x_mm"])), RIGS) == []


@pytest.mark.parametrize(
    ("shift", "reference", "sure"),
    [(0.0, "gauge", True), (0.81325, "absolute", False), (2.0, "gauge", False)],
)
def test_gauge_or_absolute_by_the_lowest_pressure(shift: float, reference: str, sure: bool) -> None:
    """0.2 bar is below the atmosphere; 1.013 bar is it; from 2.2 bar on nothing can be told."""
    data = frame("lift").assign(p_bar=lambda d: d["p_bar"] + shift)
    guess = guessed(data, "isotonic")["pressure"]
    assert (guess.reference, guess.sure) == (reference, sure)


def test_time_stamps_are_the_clock() -> None:
    stamps = pd.Timestamp("2026-03-01") + pd.to_timedelta(np.asarray(frame("lift")["t_s"]), unit="s")
    data = frame("lift").drop(columns="t_s").assign(Datum=stamps.map(lambda stamp: stamp.isoformat()))
    guess = guessed(data, "isotonic")["time"]
    assert (guess.column, guess.unit) == ("Datum", "s")


NAMINGS = {
    "counted from 0": "t|cmd/p0|cmd/p1|meas/p0|meas/p1|q",
    "one letter": "t|pd1|pd2|p1|p2|theta",
    "words": "Time (s)|desired 1 [bar]|desired 2 [bar]|pressure 1 [bar]|pressure 2 [bar]|angle (rad)",
    "measured first": "t_s|p1_meas|p2_meas|p1_des|p2_des|q",
}


@pytest.mark.parametrize("naming", NAMINGS)
def test_two_muscles_by_other_names(naming: str) -> None:
    names = NAMINGS[naming].split("|")
    found = {n: g.column for n, g in guessed(frame("swing").set_axis(names, axis=1), "joint").items()}
    order = [0, 3, 4, 1, 2, 5] if naming == "measured first" else range(6)
    assert list(found.values()) == [names[i] for i in order]


def test_which_muscle_is_the_first_is_not_known_without_a_number() -> None:
    names = ["t_s", "cmd_left_bar", "cmd_right_bar", "p_left_bar", "p_right_bar", "theta_deg"]
    guesses = guessed(frame("swing").set_axis(names, axis=1), "joint")
    assert [guess.column for guess in guesses.values()] == names
    assert not any(guesses[name].sure for name in ("command_1", "command_2", "pressure_1", "pressure_2"))
    assert "taken as number 2 by its place among the columns" in guesses["pressure_2"].said


def test_columns_with_missing_numbers_are_columns_all_the_same() -> None:
    data = frame("lift")
    data.loc[100:120, ["p_bar", "valve_V"]] = np.nan
    found = {name: guess.column for name, guess in guessed(data, "isotonic").items()}
    assert list(found.values()) == list(data.columns)
    draft = draft_card(table_of_frame("DataFrame", data), RIGS["isotonic"])
    assert draft.hints["full_command"] == "the table goes to 5 V"
