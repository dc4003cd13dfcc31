"""Rows of a recording: a stretch and a thinning that are asked for, and what is taken of a long one."""

import dataclasses
import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.cli import app
from jaxmuscle.recordings import LongRecording, row_selection
from jaxmuscle.recordings.row_selection import request_of, selected

HELD = {"held": ("command",), "largest_step": 2e-3}


def test_the_sample_is_taken_whole(lift):
    whole = jm.read(lift.table)
    assert len(whole) == 6000 and whole.left_out == ""


def test_a_stretch_is_taken_from_the_table(lift):
    whole = jm.read(lift.table)
    for asked in ("2:4.5", (2, 4.5), " 2 : 4.5 "):
        part = jm.read(lift.table, stretch=asked)
        first = int(np.flatnonzero(np.isclose(whole.time, 2))[0])
        assert part.time[0] == whole.time[first] and part.time[-1] == pytest.approx(4.5)
        np.testing.assert_array_equal(
            part.columns["pressure"], whole.columns["pressure"][first : first + 1251]
        )
    assert part.left_out == (
        "lift.csv has 6000 rows, of which 1251 are taken: the samples from 2 s to 4.5 s, as asked for."
    )
    assert len(jm.read(lift.table, stretch=":4")) == 2001 and len(jm.read(lift.table, stretch="10:")) == 1000
    assert len(jm.read(lift.table, stretch="all")) == 6000


def test_what_is_wrong_outside_of_the_stretch_does_no_harm(lift):
    def broken(table):
        return table[(table["t_s"] < 5) | (table["t_s"] > 6)]

    lift.change(broken)
    with pytest.raises(InputError, match="gap of more than 20 steps.*--stretch"):
        jm.read(lift.table)
    assert jm.read(lift.table, stretch=(6, 20)).time[0] > 6


def test_rows_of_messages_are_those_of_the_file(lift):
    lift.line(3002, "9.0,5,0.3,1")
    with pytest.raises(InputError, match="row 3003: time has to increase"):
        jm.read(lift.table, stretch=(4, 10))


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"stretch": "5"}, "stretch: expected FROM:TO in seconds"),
        ({"stretch": "1:2:3"}, "stretch: expected FROM:TO"),
        ({"stretch": "a:b"}, "stretch: expected FROM:TO in seconds"),
        ({"stretch": (1, 2, 3)}, "stretch: expected FROM:TO"),
        ({"stretch": "1:nan"}, "stretch: expected FROM:TO"),
        ({"stretch": 4}, "stretch: expected FROM:TO"),
        ({"stretch": (4, 2)}, "that ends after it begins"),
        (
            {"stretch": (100, 200)},
            "no row of .*lift.csv lies from 100 s to 200 s; its clock runs from 0 s to",
        ),
        ({"stretch": (1, 1.1)}, "expected at least 200 rows"),
        ({"every": 0}, "every: expected a number of samples, 1 or more; got 0"),
        ({"every": 1.5}, "every: expected a number of samples"),
        ({"every": True}, "every: expected a number of samples"),
        ({"every": 6000}, "every: 6000 leaves 1 of 6000 rows"),
        ({"stretch": (0, 0.9)}, "horizon"),
    ],
)
def test_what_cannot_be_taken_is_told(lift, asked, told):
    with pytest.raises(InputError, match=told):
        jm.read(lift.table, **asked)


def test_a_thinned_command_keeps_its_mean_and_a_reading_its_sample():
    time, command = 0.001 * np.arange(10, dtype=np.float64), np.arange(10.0)
    reading = command**2
    found = selected("x", time, {"command": command, "angle": reading}, request_of(None, 3), **HELD)
    np.testing.assert_allclose(found.time, [0, 0.003, 0.006])
    np.testing.assert_allclose(found.columns["command"], [1, 4, 7])
    np.testing.assert_array_equal(found.columns["angle"], [0, 9, 36])
    assert found.told == "x has 10 rows, of which 3 are taken: every 3rd sample, as asked for."
    assert not found.unasked


def test_runs_are_thinned_apart():
    time, values = 0.001 * np.arange(10, dtype=np.float64), np.arange(10.0)
    found = selected("x", time, {"angle": values}, request_of(None, 2), breaks=(5,), **HELD)
    np.testing.assert_array_equal(found.columns["angle"], [0, 2, 5, 7])
    assert found.breaks == (2,)


def test_of_a_long_recording_the_stretch_that_moves_is_taken(monkeypatch):
    monkeypatch.setattr(row_selection, "MOST_ROWS", 1000)
    rows = 20_000
    time = 0.0005 * np.arange(rows, dtype=np.float64)
    moving = (time > 6) & (time < 8)
    command = np.where(moving, np.sin(20 * time), 0.0)
    angle = np.where(moving, np.cos(20 * time), np.nan)
    found = selected("long", time, {"command": command, "angle": angle}, request_of(None, None), **HELD)
    assert len(found.time) == 1000 and found.unasked
    # Thinned from 0.5 to 2 ms, and then cut: all of what moves lies in it.
    assert found.time[0] <= 6 and found.time[-1] >= 7.99
    np.testing.assert_allclose(np.diff(found.time), 0.002)
    assert found.told == (
        f"long has 20000 rows, of which 1000 are taken: every 4th sample from {found.time[0]:.6g} s to "
        f"{found.time[-1]:.6g} s (there the signals move most), since more than 1000 take much memory and "
        'time; choose others with stretch (--stretch FROM:TO, or "all") and every (--every N).'
    )
    all_of_it = selected("long", time, {"command": command}, request_of("all", None), **HELD)
    assert len(all_of_it.time) == rows and all_of_it.told == ""


def test_a_slow_rig_is_not_thinned_beyond_the_step_of_its_valves(monkeypatch):
    monkeypatch.setattr(row_selection, "MOST_ROWS", 1000)
    time = 0.001 * np.arange(100_000, dtype=np.float64)
    asked = {"held": (), "largest_step": np.inf}
    found = selected("long", time, {"force": np.sin(time)}, request_of(None, None), **asked)
    assert found.time[1] - found.time[0] == pytest.approx(0.002)


def test_arrays_in_memory_warn(monkeypatch):
    monkeypatch.setattr(row_selection, "MOST_ROWS", 1000)
    given = jm.read(jm.sample("lift"), stretch="all")
    actuator = jm.actuator(given.card)
    with pytest.warns(LongRecording, match="'recording' has 6000 rows, of which 1000 are taken"):
        taken = jm.recording(actuator, given.columns, given.step)
    assert len(taken) == 1000 and "move most" in taken.left_out and "move most" in taken._repr_html_()
    assert len(jm.recording(actuator, given.columns, given.step, stretch="all")) == 6000
    cut = jm.recording(actuator, given.columns, given.step, stretch=(2, 4), breaks=[1500, 5000])
    assert len(cut) == 1001 and cut.breaks == (500,)
    with pytest.raises(InputError, match="horizon: expected a time from one step.*'recording' has 6000 rows"):
        jm.recording(actuator, given.columns, given.step, stretch=(2, 4), horizon=3.0)


def test_the_program_tells_what_it_takes(lift, monkeypatch):
    monkeypatch.setattr(row_selection, "MOST_ROWS", 4000)
    told = "lift.csv has 6000 rows, of which 4000 are taken"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcome = CliRunner().invoke(app, ["check", str(lift.card)])
    assert outcome.exit_code == 0 and told in outcome.stdout
    asked = CliRunner().invoke(app, ["check", str(lift.card), "--stretch", "1:5", "--every", "2"])
    assert "2001 samples in 4 s" in asked.stdout
    assert "of which 1000 are taken: every 2nd sample from 1 s to" in asked.stdout
    wrong = CliRunner().invoke(app, ["check", str(lift.card), "--stretch", "5"])
    assert wrong.exit_code == 2 and "stretch: expected FROM:TO" in wrong.stderr


def test_results_tell_what_was_taken():
    from report.fake import diagnosis

    from jaxmuscle.report.page import page
    from jaxmuscle.report.report_files import result

    found = diagnosis("complete")
    assert "left_out" not in json.loads(json.dumps(result(found)))["recording"]
    said = "long.csv has 9 rows, of which 3 are taken"
    part = dataclasses.replace(found, recording=dataclasses.replace(found.recording, left_out=said))
    assert result(part)["recording"]["left_out"] == said
    assert said in page(part)


LONG = 1_500_000
GIB = 2**30
MEASURE = """
import re, sys, warnings
from pathlib import Path
import jaxmuscle as jm
warnings.simplefilter("ignore")
recording = jm.read(sys.argv[1])
# Not ru_maxrss: that begins with the peak of the process that started this one.
kilobytes = re.search(r"VmHWM:\\s*(\\d+) kB", Path("/proc/self/status").read_text())
print(len(recording), 1024 * int(kilobytes.group(1)))
print(recording.left_out)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak of memory is read from /proc")
def test_a_long_table_is_read_within_a_gibibyte(tmp_path: Path, lift):
    sample = pd.read_csv(lift.table)
    parts = -(-LONG // len(sample))
    table = pd.concat([sample] * parts, ignore_index=True).iloc[:LONG]
    table["t_s"] = np.round(0.001 * np.arange(LONG, dtype=np.float64), 3)
    table.to_csv(lift.table, index=False)
    ended = subprocess.run(
        [sys.executable, "-c", MEASURE, str(lift.table)],
        text=True,
        capture_output=True,
        check=True,
        timeout=300,
    )
    first, told = ended.stdout.splitlines()
    rows, peak = map(int, first.split())
    assert rows == row_selection.MOST_ROWS
    assert f"lift.csv has {LONG} rows" in told
    assert peak < GIB, f"{peak / GIB:.2f} GiB"
