"""`jaxmuscle simulate`: a card and a table of commands in, a table that the card describes out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

import jaxmuscle as jm
from jaxmuscle.cli import app
from jaxmuscle.recordings import Card
from jaxmuscle.samples import sample

Run = Callable[..., Result]
TIME = 0.002 * np.arange(100)
WAVE = 4 * np.sin(20 * TIME)
LIFT, SWING = (sample(name).with_suffix(".toml") for name in ("lift", "swing"))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the program in a folder with tables of commands for two of the samples."""
    pd.DataFrame({"t_s": TIME, "valve_V": WAVE}).to_csv(tmp_path / "valve.csv", index=False)
    both = {"t_s": TIME, "cmd1_bar": 2.5 + 0.1 * WAVE, "cmd2_bar": 2.5 - 0.1 * WAVE, "note": "x"}
    pd.DataFrame(both).to_csv(tmp_path / "regulators.csv", index=False)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, ["simulate", *map(str, arguments)])


def test_readings_are_those_of_the_package_in_units_of_the_card(run: Run, tmp_path: Path) -> None:
    outcome = run(LIFT, "--command", "valve.csv")
    assert outcome.exit_code == 0, outcome.stderr
    assert outcome.stdout == "lift-simulated.csv\n"
    assert sorted(p.name for p in tmp_path.glob("lift*")) == ["lift-simulated.csv"]
    table = pd.read_csv("lift-simulated.csv")
    assert list(table.columns) == ["t_s", "valve_V", "p_bar", "x_mm"]
    machine = jm.actuator(Card.read(LIFT))
    readings = jm.simulate(machine, WAVE, TIME).readings
    np.testing.assert_allclose(table["valve_V"], WAVE, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(table["p_bar"], np.asarray(readings["pressure"]) / 1e5 - 1.01325, atol=1e-8)
    np.testing.assert_allclose(table["x_mm"], 1e3 * np.asarray(readings["position"]), atol=1e-7)


def test_what_is_written_is_a_recording_of_the_card(run: Run) -> None:
    """Joined with what the sensors show, the table goes through the reader that recordings go through."""
    time = 0.002 * np.arange(300)
    pd.DataFrame({"t_s": time, "valve_V": 5 - 9 * (time > 0.3)}).to_csv("steps.csv", index=False)
    assert run(LIFT, "--command", "steps.csv", "--output", "made.csv").exit_code == 0
    card = Path("made.toml")
    card.write_text(LIFT.read_text().replace('value = 1, unit = "s"', 'value = 0.2, unit = "s"'))
    made = jm.read("made.csv", card)
    readings = jm.simulate(jm.actuator(made.card), made.columns["command"], made.time).readings
    np.testing.assert_allclose(made.columns["pressure"], readings["pressure"], rtol=1e-8)
    np.testing.assert_allclose(made.columns["position"], readings["position"], atol=1e-11)


def test_start_steps_and_picture(run: Run, tmp_path: Path) -> None:
    begin = ("--start", "pressure_1=2.5", "--start", "pressure_2=351325:Pa:absolute", "--start", "angle=-3")
    more = ("--start", "angular_velocity=0.5", "--substeps", "2", "--plot", "--output", "joint.csv")
    outcome = run(SWING, "--command", "regulators.csv", *begin, *more)
    assert outcome.exit_code == 0, outcome.stderr
    assert outcome.stdout.splitlines() == ["joint.csv", "joint.png"]
    assert Path("joint.png").read_bytes().startswith(b"\x89PNG")
    table = pd.read_csv("joint.csv")
    assert table.iloc[0][["p1_bar", "p2_bar", "theta_deg"]].tolist() == pytest.approx([2.5, 2.5, -3])
    commands = 1e5 * np.stack([2.5 + 0.1 * WAVE, 2.5 - 0.1 * WAVE], axis=-1) + 101325
    start = {"pressure": np.full(2, 351325.0), "angle": np.deg2rad(-3), "angular_velocity": 0.5}
    alone = jm.simulate(jm.actuator(Card.read(SWING)), commands, TIME, start=start, substeps=2)
    np.testing.assert_allclose(table["theta_deg"], np.rad2deg(alone.readings["angle"]), atol=1e-7)


def test_an_irregular_clock_is_resampled_when_asked_for(run: Run) -> None:
    table = pd.read_csv("valve.csv")
    table.loc[50:, "t_s"] += 0.0005
    table.to_csv("valve.csv", index=False)
    outcome = run(LIFT, "--command", "valve.csv")
    assert outcome.exit_code == 2 and "irregular sampling" in outcome.stderr
    assert run(*GIVEN, "--resample", "--tolerance", "1e-4").exit_code == 0


def wrong_card(name: str, old: str, new: str) -> Path:
    file = Path(f"{name}.toml")
    file.write_text(LIFT.read_text().replace(old, new))
    return file


GIVEN = (LIFT, "--command", "valve.csv")
BENCH = sample("bench").with_suffix(".toml")
BAD = {
    "no card": (("absent.toml", "--command", "valve.csv"), "no card 'absent.toml'"),
    "no commands": ((LIFT, "--command", "absent.csv"), "no table of commands 'absent.csv'"),
    "other columns": ((LIFT, "--command", "regulators.csv"), "'valve_V' (command): is not in the table"),
    "a rig without": ((BENCH, "--command", "valve.csv"), "'driven' has no command"),
    "another ending": ((*GIVEN, "--output", "a.xlsx"), "a name that ends in .csv"),
    "no folder": ((*GIVEN, "--output", "a/b.csv"), "there is no folder"),
    "a folder": ((*GIVEN, "--output", "taken.csv"), "it is a folder"),
    "no value": ((*GIVEN, "--start", "pressure"), "--start pressure: expected NAME=VALUE"),
    "no number": ((*GIVEN, "--start", "pressure=much"), "expected NAME=VALUE"),
    "no finite one": ((*GIVEN, "--start", "pressure=nan"), "finite numbers"),
    "two values": ((*GIVEN, "--start", "pressure=1,2"), "one value; got 2"),
    "no such state": (
        (*GIVEN, "--start", "pressur=1"),
        "--start: unknown state 'pressur'; did you mean 'pressure'?",
    ),
    "another unit": ((*GIVEN, "--start", "position=1:bar"), "got unit = 'bar'"),
    "no reference": (
        (*GIVEN, "--start", "position=1:mm:gauge"),
        "do not know what 'mm:gauge' is",
    ),
    "substeps": ((*GIVEN, "--substeps", "0"), "substeps: expected a whole number"),
    "tolerance": ((*GIVEN, "--tolerance", "3"), "tolerance: expected a relative error"),
    "no option": ((*GIVEN, "--nonsense"), "No such option"),
    "nothing given": ((LIFT,), "Missing option '--command'"),
}  # fmt: skip


@pytest.mark.parametrize("why", BAD)
def test_bad_input_is_told_and_nothing_is_written(run: Run, tmp_path: Path, why: str) -> None:
    arguments, told = BAD[why]
    (tmp_path / "taken.csv").mkdir()
    before = sorted(p.name for p in tmp_path.iterdir())
    outcome = run(*arguments)
    assert outcome.exit_code == 2, outcome.output
    assert told in " ".join(outcome.stderr.split()) and "Traceback" not in outcome.stderr
    assert outcome.stdout == ""
    assert sorted(p.name for p in tmp_path.iterdir()) == before and not any(
        (tmp_path / "taken.csv").iterdir()
    )


@pytest.mark.parametrize(
    ("column", "values", "told"),
    [
        ("t_s", TIME[::-1], "time has to increase"),
        ("t_s", TIME * 1e-5, "a sampling step of 2e-08 s is not plausible"),
        ("valve_V", [*WAVE[:-1], np.nan], "row 101: expected a number; got an empty field or NaN"),
    ],
)
def test_tables_of_commands_are_checked(run: Run, column: str, values: np.ndarray, told: str) -> None:
    table = pd.read_csv("valve.csv")
    table[column] = values
    table.to_csv("valve.csv", index=False)
    outcome = run(*GIVEN, "--plot")
    assert outcome.exit_code == 2 and told in outcome.stderr
    assert not list(Path().glob("lift*"))


def test_a_pressure_that_cannot_be_is_told(run: Run) -> None:
    table = pd.read_csv("regulators.csv")
    table["cmd1_bar"] -= 5
    table.to_csv("regulators.csv", index=False)
    outcome = run(SWING, "--command", "regulators.csv")
    assert outcome.exit_code == 2
    assert "column 'cmd1_bar' (command_1): -1.487 bar absolute in row 2 is below vacuum" in outcome.stderr


def test_one_row_is_too_few(run: Run) -> None:
    Path("one.csv").write_text("t_s,valve_V\n0,1\n")
    outcome = run(LIFT, "--command", "one.csv")
    assert outcome.exit_code == 2 and "expected at least 2 rows of samples; got 1" in outcome.stderr


def test_a_machine_that_runs_away_is_told(run: Run) -> None:
    """A start that no muscle can have: the picture that was there stays as it was."""
    Path("lift-simulated.csv").write_text("mine")
    outcome = run(*GIVEN, "--start", "velocity=1e200", "--plot")
    assert outcome.exit_code == 2
    assert "the machine ran away: its" in outcome.stderr and "--substeps" in outcome.stderr
    assert Path("lift-simulated.csv").read_text() == "mine" and not Path("lift-simulated.png").exists()
