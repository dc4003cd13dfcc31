"""Tables of published numbers count what was published, once, and say it in JSON that any reader takes."""

import importlib.util
import json
import math
import sys
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "benchmarks" / "published_rows.py"


@pytest.fixture(scope="module")
def table():
    spec = importlib.util.spec_from_file_location("published_rows", FILE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def rows(table):
    near = table.near("[T] 5", "force", 100.0, 101.0, "N", 0.02, "digits")
    missed = table.row("[H]", "corner", "80", math.inf, False, "Hz")
    own = table.aside(table.row("[W]", "of our own", "-", [0.5, math.nan], True), table.OWN)
    other = table.aside(table.near("[T] 5", "force", 100.0, 150.0, "N", 0.02, "digits"), table.OTHER)
    words = table.aside(
        table.row("[T]", "contraction", "some tenths of a second", 0.4, True, "s"), table.WORDS
    )
    return [near, missed, own, {**other, "reading": "another unit"}, words]


def test_only_numbers_of_the_source_under_the_declared_reading_are_counted(table, rows):
    nothing = {"reached": 0, "of": 0}
    assert table.counts(rows) == {
        "reached": 1,
        "of": 2,
        "chosen": nothing,
        "aside": {
            table.OTHER: {"reached": 0, "of": 1},
            table.OWN: {"reached": 1, "of": 1},
            table.WORDS: {"reached": 1, "of": 1},
        },
    }


def test_rows_that_rest_on_a_number_chosen_here_say_so_and_are_counted_apart(table, rows):
    near, missed, own, *_ = (table.assuming(entry, "the play's width") for entry in rows)
    found = table.counts([near, missed, own])
    assert (found["reached"], found["of"]) == (1, 2)
    assert found["chosen"] == {"reached": 1, "of": 2}
    assert "chosen here: the play's width" in table.line(near)


@pytest.mark.parametrize(
    ("printed", "half"), [("-14.5", 0.05), ("1084", 0.5), ("0.3856", 5e-5), ("7.10", 0.005), ("1.2e3", 50.0)]
)
def test_half_a_unit_of_the_last_digit(table, printed, half):
    assert table.half_digit(printed) == pytest.approx(half, rel=1e-12)


def test_half_a_digit_of_what_is_no_number(table):
    with pytest.raises(ValueError, match="about"):
        table.half_digit("about 7")


@pytest.mark.parametrize(
    ("goal", "ours", "ok"),
    [("-5.0", -5.05, True), ("-5.0", -4.626, False), ("2.2", 2.067, False), ("0.296", 0.29590, True)],
)
def test_a_printed_number_is_met_to_its_last_digit(table, goal, ours, ok):
    assert table.as_printed("[H]", "pole", goal, ours)["ok"] is ok


def test_a_bound_is_met_to_what_its_digits_allow(table):
    assert table.at_most("[T]", "error", "0.5", 0.5)["ok"]
    assert not table.at_most("[T]", "error", "0.5", 0.5065)["ok"]
    assert table.at_most("[T]", "error", "0.5", 0.5065, allowed=0.05)["ok"]


def test_what_is_missed_says_why_and_what_is_reached_does_not(table):
    assert table.as_printed("[H]", "pole", "-5.0", -4.6)["why"] == table.NOT_UNDERSTOOD
    assert table.as_printed("[H]", "pole", "-5.0", -4.6, why="warmer gas")["why"] == "warmer gas"
    assert "why" not in table.as_printed("[H]", "pole", "-5.0", -5.0, why="warmer gas")


def test_rows_say_their_reading_unless_they_have_one(table, rows):
    found = list(table.under("declared", rows))
    assert [entry["reading"] for entry in found] == ["declared"] * 3 + ["another unit", "declared"]
    assert table.line(found[0]).startswith("ok [T] 5: force: 101 N") and "[declared]" in table.line(found[0])
    assert table.line(found[3]).startswith("NO (another reading) [T] 5")


def test_what_is_printed_ends_in_counts_and_plain_json(table, rows, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["table", "--json"])
    assert table.printed("name", "about", lambda: rows) == 0
    *_, count, first, second, third, last = capsys.readouterr().out.splitlines()
    assert count == "1 of 2"
    assert {first, second, third} == {
        "not counted, another reading: 0 of 1",
        "not counted, own check: 1 of 1",
        "not counted, in words: 1 of 1",
    }

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    said = json.loads(last, parse_constant=refuse)
    assert (said["reached"], said["of"]) == (1, 2)
    assert said["rows"][1]["ours"] is None and said["rows"][2]["ours"] == [0.5, None]
