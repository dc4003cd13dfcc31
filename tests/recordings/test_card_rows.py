"""Rows that a card names: ignored, held out, breaks."""

import dataclasses
import tomllib

import numpy as np
import pandas as pd
import pytest

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings import LongRecording, row_selection
from jaxmuscle.recordings.joining import distinct, joined, of_one_bench
from jaxmuscle.recordings.spans import held_out_part, rows_within

ROWS = """
[ignore]
slack = { from = 1, to = 2000, unit = "ms" }
saturated = { from = 4, to = 5, unit = "s", column = "pressure" }

[held_out]
last = { from = 9, unit = "s" }
first = { to = 0.5, unit = "s" }

[breaks]
second_run = { at = 6, unit = "s" }
"""
TEXT = jm.sample("lift").with_suffix(".toml").read_text(encoding="utf-8")


def card(rows=ROWS):
    return jm.Card.from_toml(TEXT + rows)


@pytest.fixture(scope="module")
def recording():
    return jm.read(jm.sample("lift"), card(ROWS.replace("from = 1,", "from = 1000,")))


def test_rows_are_those_of_the_clock(recording):
    time = recording.time
    slack, saturated = (time >= 1) & (time <= 2), (time >= 4) & (time <= 5)
    np.testing.assert_array_equal(recording.ignored["position"], slack)
    np.testing.assert_array_equal(recording.ignored["pressure"], slack | saturated)
    np.testing.assert_array_equal(recording.held_out, (time >= 9) | (time <= 0.5))
    assert recording.breaks == (3000,)
    assert "command" not in recording.ignored


def test_rows_of_the_card_are_thinned_and_cut_with_the_columns(recording):
    thin = jm.read(jm.sample("lift"), recording.card, every=5)
    assert len(thin) == 1200 and thin.breaks == (600,)
    np.testing.assert_array_equal(thin.held_out, recording.held_out[::5])
    for column, rows in recording.ignored.items():
        np.testing.assert_array_equal(thin.ignored[column], rows[::5])
    part = jm.read(jm.sample("lift"), recording.card, stretch=(4.5, 8))
    time = part.time
    np.testing.assert_array_equal(part.ignored["pressure"], time <= 5)
    # What the card names elsewhere is not missed.
    assert set(part.ignored) == {"pressure"} and part.held_out is None
    assert part.breaks == (int(np.argmax(time >= 6)),)


def test_what_the_card_ignores_counts_in_no_fit_and_no_diagnosis(recording):
    prepared = case(recording, 0.3)
    for column, rows in recording.ignored.items():
        assert not prepared.usable[column][rows].any() and prepared.usable[column][~rows].all()
    starts = prepared.windows.rows
    assert 3000 in starts, "a new run begins a window"


def test_written_cards_say_the_same():
    given = card()
    assert jm.Card.from_toml(given.to_toml()) == given
    bare = dataclasses.replace(given, text=None)
    assert jm.Card.parse(tomllib.loads(bare.to_toml())) == bare
    assert 'slack = { from = 1, to = 2000, unit = "ms" }' in bare.to_toml()
    assert 'second_run = { at = 6, unit = "s" }' in bare.to_toml()


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("[ignore]\na = { from = 3, to = 2, unit = 's' }", "ends after it begins"),
        ("[ignore]\na = { from = 3, unit = 'mm' }", "a time"),
        ("[ignore]\na = { from = 3 }", "expected a unit"),
        ("[ignore]\na = { from = 'x', unit = 's' }", "expected a finite number"),
        ("[ignore]\na = 3", "expected { from"),
        ("[ignore]\na = { from = 3, unit = 's', column = 'presure' }", "did you mean 'pressure'"),
        ("[ignore]\na = { from = 3, unit = 's', column = 'command' }", "unknown column 'command'"),
        ("[ignore]\n'a b' = { from = 3, unit = 's' }", "name of letters"),
        ("[held_out]\na = { from = 3, unit = 's', column = 'pressure' }", "unknown key 'column'"),
        ("[breaks]\na = { from = 3, unit = 's' }", "unknown key 'from'"),
    ],
)
def test_entries_that_are_none(rows, told):
    with pytest.raises(InputError) as error:
        card(rows)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("[ignore]\na = { from = 300, unit = 's' }", "[ignore] a: no row lies there; the clock runs from"),
        ("[held_out]\na = { to = -1, unit = 's' }", "[held_out] a: no row lies there"),
        ("[breaks]\na = { at = 0, unit = 's' }", "[breaks] a: expected a time after the first row"),
        ("[breaks]\na = { at = 13, unit = 's' }", "[breaks] a: expected a time after the first row"),
    ],
)
def test_rows_that_are_not_there(rows, told):
    with pytest.raises(InputError) as error:
        jm.read(jm.sample("lift"), card(rows))
    assert told in str(error.value)


def test_joined_recordings_keep_what_their_cards_say(recording):
    plain = jm.read(jm.sample("lift"))
    whole = joined([plain.part(0, 1000), recording.part(500, 2500)], "both")
    assert not whole.ignored["position"][:1000].any()
    np.testing.assert_array_equal(whole.ignored["position"][1000:], recording.ignored["position"][500:2500])
    assert whole.held_out is not None
    assert not whole.held_out[:1000].any()
    names = [(each.name, each.first, each.rows, each.begin) for each in whole.members]
    assert names == [("lift", 0, 1000, 0.0), ("lift-2", 1000, 2000, pytest.approx(1.0))]
    part = whole.part(900, 1500)
    assert [(each.first, each.rows) for each in part.members] == [(0, 100), (100, 500)]
    assert part.members[0].begin == pytest.approx(1.8)


def test_names_are_distinct():
    assert distinct(["a-2", "a", "a"]) == ["a-2", "a", "a-3"]


def test_recordings_of_different_benches(recording):
    with pytest.raises(InputError, match="at least one"):
        of_one_bench([])
    slow = dataclasses.replace(recording, step=0.004)
    with pytest.raises(InputError, match=r"one sampling step; got lift 0.002 s, lift-2 0.004 s"):
        of_one_bench([recording, slow])
    assert of_one_bench([recording]) is recording
    unsure = recording.card.updated(values={"mass": (9.0, 0.1)})
    with pytest.raises(InputError, match=r"differ in \[known\] mass"):
        of_one_bench([recording, dataclasses.replace(recording, card=unsure)])


def test_a_long_recording_keeps_rows_to_fit_and_rows_to_hold_out(monkeypatch):
    monkeypatch.setattr(row_selection, "MOST_ROWS", 1000)
    loud = "noisy = { from = 7, to = 8.5, unit = 's', column = 'position' }"
    text = f"{TEXT}\n[ignore]\n{loud}\n[held_out]\nend = {{ from = 6, unit = 's' }}\n"
    table = pd.read_csv(jm.sample("lift"))
    shaken = ((table["t_s"] > 7) & (table["t_s"] < 8.5)).to_numpy()
    table.loc[shaken, "x_mm"] += np.random.default_rng(0).normal(scale=10, size=np.count_nonzero(shaken))
    with pytest.warns(LongRecording):
        taken = jm.read(table, jm.Card.from_toml(text))
    assert len(taken) == 1000 and taken.held_out is not None and 0.1 <= taken.held_out.mean() <= 0.9
    # What the broken sensor shows does not count as motion.
    assert not taken.ignored.get("position", np.zeros(1000, dtype=bool)).all()


@pytest.mark.parametrize("stretch", ["all", "2:5"])
def test_a_span_beyond_the_table_is_told_whatever_is_asked_for(stretch):
    late = f"{TEXT}\n[held_out]\nlate = {{ from = 4000, unit = 's' }}\n"
    with pytest.raises(InputError, match=r"\[held_out\] late: no row lies there"):
        jm.read(jm.sample("lift"), jm.Card.from_toml(late), stretch=stretch)


def test_a_break_at_the_first_row_of_a_stretch_is_its_beginning():
    text = f"{TEXT}\n[breaks]\nsecond = {{ at = {6 / 60!r}, unit = 'min' }}\n"
    assert jm.read(jm.sample("lift"), jm.Card.from_toml(text), stretch=(6, 9)).breaks == ()


def test_a_list_is_no_column():
    text = f"{TEXT}\n[ignore]\nslack = {{ from = 1, to = 2, unit = 's', column = ['pressure'] }}\n"
    with pytest.raises(InputError, match=r"unknown column \['pressure'\]"):
        jm.Card.from_toml(text)


def test_the_unit_that_a_card_is_written_in_makes_no_other_machine():
    grams = TEXT.replace('mass = { value = 8, unit = "kg" }', 'mass = { value = 8000, unit = "g" }')
    assert grams != TEXT
    pair = [jm.read(jm.sample("lift"), jm.Card.from_toml(text)) for text in (TEXT, grams)]
    assert len(of_one_bench(pair)) == 12_000 and of_one_bench(pair).differences == {}
    heavier = jm.read(jm.sample("lift"), jm.Card.from_toml(grams.replace("8000", "8100")))
    assert of_one_bench([pair[0], heavier]).differences["mass"][-1] == pytest.approx(0.1)


def test_thinned_beside_whole_is_told_with_what_to_ask_for():
    whole, thin = (jm.read(jm.sample("lift"), card(""), every=every) for every in (1, 2))
    with pytest.raises(InputError, match="one sampling step.*--every N"):
        of_one_bench([whole, thin])


def test_each_of_several_recordings_has_a_clock_of_its_own():
    one = jm.read(jm.sample("lift"), card(""))
    longer = dataclasses.replace(one, time=one.time * 1.009, step=one.step * 1.009, name="longer")
    rows = rows_within(of_one_bench([one, longer]), ["longer:12:"], "--held-out")
    np.testing.assert_array_equal(rows[6000:], longer.time >= 12 - 1e-8)
    assert not rows[:6000].any()
    with pytest.raises(InputError, match="--held-out d: expected NAME:FROM:TO.*lift, longer"):
        held_out_part(of_one_bench([one, longer]), ["d"], "--held-out")
    assert held_out_part(of_one_bench([one, longer]), ["0.2"], "--held-out") == 0.2
