"""`jaxmuscle init` and `jaxmuscle check`, as a new user meets them."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
from jaxmuscle.actuators import RIGS
from jaxmuscle.cli import app
from jaxmuscle.recordings import Card, schema
from jaxmuscle.recordings.data_sheets import all_sources, data_sheets
from jaxmuscle.samples import sample

pytestmark = pytest.mark.usefixtures("package_rigs")

Run = Callable[..., Result]
PACKAGED = [name for name, rig in RIGS.items() if rig.__module__.startswith("jaxmuscle.")]
FACTS = {
    "full_command": "5:V",
    "supply_pressure": "7:bar:gauge",
    "initial_length": "300:mm",
    "initial_radius": "7:mm",
    "braid_angle": "22:deg",
    "mass": "8:kg",
    "valve_area": "1.17+-0.2:mm^2",
    "valve_time_constant": "7.3+-1:ms",
    "end_factor": "1.3+-0.05",
}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the program in a folder with a table as a German spreadsheet writes it."""
    table = pd.read_csv(sample("lift"))
    table.columns = ["Zeit [s]", "Ventil, Spannung (V)", "Druck [bar]", "Weg [mm]"]
    table.to_csv(tmp_path / "bank.csv", sep=";", decimal=",", index=False)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments, **how: CliRunner().invoke(app, [str(a) for a in arguments], **how)


def test_from_a_table_to_a_card_that_passes(run: Run) -> None:
    outcome = run("init", "bank.csv")
    assert outcome.exit_code == 0, outcome.output
    assert "By its columns the rig is 'isotonic'" in outcome.stderr
    assert 'To be filled in, marked "?" in the card: valve_area' in outcome.stdout
    assert "bank.toml\nbank.columns.png\nThen: jaxmuscle check bank.toml" in outcome.stdout
    assert Path("bank.columns.png").read_bytes()[:4] == b"\x89PNG"
    checked = run("check", "bank.toml")
    assert checked.exit_code == 2 and "9 problems" in checked.stderr
    assert "Druck [bar]" in checked.stdout and "5.5767" in checked.stdout
    text = Path("bank.toml").read_text()
    for name, fact in FACTS.items():
        number, _, reference = (*fact.split(":"), "", "")[:3]
        value, _, std = number.partition("+-")
        old = next(line for line in text.splitlines() if line.startswith(f"{name} = "))
        new = old.replace('value = "?"', f"value = {value}").replace('std = "?"', f"std = {std}")
        text = text.replace(old, new.replace('reference = "?"', f'reference = "{reference}"'))
    Path("bank.toml").write_text(text)
    checked = run("check", "bank.toml")
    assert checked.exit_code == 0, checked.stderr
    assert "Nothing is wrong. Next: jaxmuscle diagnose bank.csv" in checked.stdout
    assert "6000 samples in 11.998 s, every 2 ms (500 Hz), regular" in checked.stdout
    rows = [line.split() for line in checked.stdout.splitlines()]
    assert ["supply_pressure", "7", "bar", "gauge", "known", "supply", "pressure"] in rows


def test_facts_by_settings(run: Run) -> None:
    settings = [word for name, fact in FACTS.items() for word in ("--set", f"{name}={fact}")]
    arguments = ("init", "bank.csv", "--rig", "isotonic", *settings, "--out", "facts.toml", "--no-picture")
    outcome = run(*arguments)
    assert outcome.exit_code == 0 and "To be filled in" not in outcome.stdout
    assert Card.read("facts.toml").uncertain["end_factor"].std == 0.05
    assert run("check", "facts.toml", "--recording", "bank.csv").exit_code == 0
    assert not Path("bank.toml").exists() and not [*Path().glob("*.png")]


def test_a_card_is_never_replaced_unasked(run: Run) -> None:
    Path("bank.toml").write_text("mine")
    outcome = run("init", "bank.csv")
    assert outcome.exit_code == 2 and "bank.toml is there already" in outcome.stderr
    assert Path("bank.toml").read_text() == "mine"
    assert run("init", "bank.csv", "--force").exit_code == 0
    assert "isotonic" in Path("bank.toml").read_text()


def test_questions_in_a_terminal(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that cannot be is asked again, an empty one leaves the quantity open."""
    stdin = type("stdin", (), {"isatty": staticmethod(lambda: True)})
    monkeypatch.setattr("jaxmuscle.cli.cards.sys", type("sys", (), {"stdin": stdin}))
    answers = ["1.17+-0.2:kg", "1.17+-0.2", "", "5", "7:bar:gauge", *[""] * 5]
    outcome = run("init", "bank.csv", input="\n".join(answers) + "\n")
    assert outcome.exit_code == 0, outcome.output
    assert "effective valve area, fully open, valve_area [mm^2], such as 1.2 ± 0.2 mm^2" in outcome.stderr
    assert "expected an area" in outcome.stderr
    text = Path("bank.toml").read_text()
    assert 'valve_area = { value = 1.17, std = 0.2, unit = "mm^2" }' in text
    assert 'supply_pressure = { value = 7, unit = "bar", reference = "gauge" }' in text
    assert 'mass = { value = "?", unit = "kg" }' in text


def test_an_end_in_the_middle_of_the_questions_writes_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    stdin = type("stdin", (), {"isatty": staticmethod(lambda: True)})
    monkeypatch.setattr("jaxmuscle.cli.cards.sys", type("sys", (), {"stdin": stdin}))
    outcome = run("init", "bank.csv", input="1.17+-0.2\n")
    assert outcome.exit_code == 130 and "interrupted" in outcome.stderr
    assert not Path("bank.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "expected the table of a recording"),
        (("absent.csv",), "no recording 'absent.csv'"),
        (("bank.toml",), "expected a table with the ending"),
        (("bank.csv", "--rig", "isotonik"), "unknown rig 'isotonik'; did you mean 'isotonic'?"),
        (("bank.csv", "--set", "mas=8"), "did you mean 'mass'?"),
        (("bank.csv", "--out", "absent/card.toml"), "no folder"),
        (("--list", "--rig", "lift"), "unknown rig 'lift'"),
        (("swing.csv",), "the columns are enough for joint and for elbow. Say --rig NAME"),
        (("time.csv",), "no rig has such columns. Say --rig NAME"),
    ],
)
def test_bad_input(run: Run, tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    (tmp_path / "swing.csv").write_text(sample("swing").read_text())
    (tmp_path / "time.csv").write_text("t_s\n0\n1\n")
    before = sorted(tmp_path.iterdir())
    outcome = run("init", *arguments)
    assert outcome.exit_code == 2 and outcome.stdout == ""
    assert told in outcome.stderr and "Traceback" not in outcome.stderr
    assert sorted(tmp_path.iterdir()) == before


def test_check_of_what_is_not_there(run: Run) -> None:
    outcome = run("check", "absent.toml")
    assert outcome.exit_code == 2 and outcome.stdout == ""
    assert "no card 'absent.toml'" in outcome.stderr


@pytest.mark.parametrize("rig", PACKAGED)
def test_every_quantity_of_a_rig_is_listed(run: Run, rig: str) -> None:
    outcome = run("init", "--rig", rig, "--list")
    assert outcome.exit_code == 0
    rows = [line.split() for line in outcome.stdout.splitlines() if line]
    for name in (*schema.columns(RIGS[rig]), *schema.quantities(RIGS[rig])):
        assert any(row[0] == name for row in rows), name
    assert "—" not in outcome.stdout


def test_every_rig_is_listed(run: Run) -> None:
    outcome = run("init", "--list")
    assert outcome.exit_code == 0
    assert {*RIGS} <= {line.split()[0] for line in outcome.stdout.splitlines() if line}


def test_every_type_with_a_data_sheet_is_listed_with_its_sources(run: Run) -> None:
    outcome = run("init", "--types")
    assert outcome.exit_code == 0
    for sheets in data_sheets().values():
        for name, sheet in sheets.items():
            lines = [line for line in outcome.stdout.splitlines() if line.startswith(f"{name} ")]
            assert len(lines) == len(sheet.quantities)
            assert all("stated" in line or "derived" in line for line in lines)
    assert all(source in outcome.stdout for source in all_sources())


def test_check_says_what_comes_from_a_data_sheet(run: Run, tmp_path: Path) -> None:
    (tmp_path / "lift.csv").write_text(sample("lift").read_text())
    card = sample("lift").with_suffix(".toml").read_text()
    lines = [line for line in card.splitlines() if not line.startswith("end_factor")]
    (tmp_path / "lift.toml").write_text("\n".join([*lines, "[muscle]", 'type = "Festo DMSP-10"', ""]))
    outcome = run("check", "lift.toml")
    assert outcome.exit_code == 0, outcome.stderr
    (line,) = (line for line in outcome.stdout.splitlines() if line.startswith("end_factor"))
    assert "1.49 ± 0.5" in line and "to be fitted, data sheet" in line
    (line,) = (line for line in outcome.stdout.splitlines() if line.startswith("braid_angle"))
    assert "data sheet" not in line
    assert "The card also gives: muscle Festo DMSP-10, effect" in outcome.stdout


def test_a_picture_of_what_was_understood(run: Run, tmp_path: Path) -> None:
    assert run("init", "bank.csv", "--picture", "bank.svg").exit_code == 0
    drawn = Path("bank.svg").read_text()
    for words in (
        "pressure [bar gauge]",
        "column Druck [bar]",
        "position [mm]",
        "column Weg [mm]",
        "time [s]",
    ):
        assert f"<!-- {words} -->" in drawn
    assert not Path("bank.columns.png").exists()
    assert run("check", "bank.toml", "--picture", "other.png").exit_code == 2
    assert not Path("other.png").exists()  # Nothing is drawn of a card that cannot be read.
    outcome = run("init", "bank.csv", "--out", "new.toml", "--picture", "bank.txt")
    assert outcome.exit_code == 2 and "expected a file that ends with .png" in outcome.stderr
    assert not Path("new.toml").exists()


def test_check_draws_too(run: Run, tmp_path: Path) -> None:
    outcome = run("check", sample("swing").with_suffix(".toml"), "--picture", "swing.png")
    assert outcome.exit_code == 0, outcome.stderr
    assert Path("swing.png").read_bytes()[:4] == b"\x89PNG"


def test_a_card_that_is_not_there_is_told_once(run: Run) -> None:
    outcome = run("check", "absent.toml")
    assert outcome.exit_code == 2
    assert outcome.stderr.count("no card 'absent.toml'") == 1
