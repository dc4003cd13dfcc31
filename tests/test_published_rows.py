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
    return [near, missed, own, {**other, "reading": "another unit"}]


def test_own_checks_and_other_readings_are_not_counted(table, rows):
    assert table.counts(rows) == {
        "reached": 1,
        "of": 2,
        "aside": {table.OTHER: {"reached": 0, "of": 1}, table.OWN: {"reached": 1, "of": 1}},
    }


def test_rows_say_their_reading_unless_they_have_one(table, rows):
    found = list(table.under("declared", rows))
    assert [entry["reading"] for entry in found] == ["declared"] * 3 + ["another unit"]
    assert table.line(found[0]).startswith("ok [T] 5: force: 101 N") and "[declared]" in table.line(found[0])
    assert table.line(found[3]).startswith("NO (another reading) [T] 5")


def test_what_is_printed_ends_in_counts_and_plain_json(table, rows, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["table", "--json"])
    assert table.printed("name", "about", lambda: rows) == 0
    *_, count, first, second, last = capsys.readouterr().out.splitlines()
    assert count == "1 of 2"
    assert {first, second} == {"not counted, another reading: 0 of 1", "not counted, own check: 1 of 1"}

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    said = json.loads(last, parse_constant=refuse)
    assert (said["reached"], said["of"]) == (1, 2)
    assert said["rows"][1]["ours"] is None and said["rows"][2]["ours"] == [0.5, None]
