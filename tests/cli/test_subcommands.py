"""The command line: what goes where, and with which exit status."""

import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from report.fake import diagnosis
from typer.testing import CliRunner, Result

import jaxmuscle
import jaxmuscle.diagnosis as package
from jaxmuscle import InputError
from jaxmuscle.cli import BAD_INPUT, app
from jaxmuscle.cli.console import faults
from jaxmuscle.effects import BY_NAME, CATALOGUE, FURTHER
from jaxmuscle.effects.readings import KINDS
from jaxmuscle.recordings import Recording
from jaxmuscle.report.sentence import sentence
from jaxmuscle.samples import sample

Run = Callable[..., Result]


@pytest.fixture
def asked() -> list[Recording]:
    """The recordings that were diagnosed."""
    return []


@pytest.fixture
def settings() -> list[dict[str, Any]]:
    """How they were."""
    return []


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[Recording], settings: list[dict[str, Any]]
) -> Run:
    """Run the program in an empty folder, with a diagnosis that is known beforehand."""

    def diagnose(recording: Recording, *, progress: Callable[[str], None], **how: Any) -> Any:
        progress("Fitting [what] is declared")
        asked.append(recording)
        settings.append(how)
        return diagnosis("effects found")

    monkeypatch.setattr(package, "diagnose", diagnose, raising=False)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_without_a_recording_the_sample_is_diagnosed(
    run: Run, tmp_path: Path, asked: list[Recording]
) -> None:
    outcome = run("diagnose")
    assert outcome.exit_code == 0, outcome.stderr
    assert [recording.name for recording in asked] == ["lift"]
    folder = tmp_path / "jaxmuscle-lift"
    assert sorted(p.name for p in folder.iterdir()) == ["card.toml", "report.html", "result.json"]


def test_results_and_progress_are_kept_apart(run: Run) -> None:
    outcome = run("diagnose", sample("lift"), "--out", "here")
    assert sentence(diagnosis("effects found")) in outcome.stdout.splitlines()
    assert str(Path("here", "report.html")) in outcome.stdout.splitlines()
    assert "before" in outcome.stdout and "after" in outcome.stdout
    assert "Fitting [what] is declared" in outcome.stderr.splitlines()
    assert "Fitting" not in outcome.stdout


def test_no_report(run: Run, tmp_path: Path) -> None:
    assert run("diagnose", "--no-report", "--out", "here").exit_code == 0
    assert sorted(p.name for p in (tmp_path / "here").iterdir()) == ["card.toml", "result.json"]


def test_card_can_be_named(run: Run, tmp_path: Path, asked: list[Recording]) -> None:
    card = tmp_path / "other.toml"
    text = sample("lift").with_suffix(".toml").read_text(encoding="utf-8")
    card.write_text(text.replace("value = 8,", "value = 9,"), encoding="utf-8")
    assert run("diagnose", sample("lift"), "--card", card, "--out", "here").exit_code == 0
    assert asked[0].card.known["mass"].value == 9


@pytest.mark.slow
def test_rows_can_be_ignored_and_held_out(
    run: Run, asked: list[Recording], settings: list[dict[str, Any]]
) -> None:
    assert run("diagnose").exit_code == 0
    assert settings[0] == {
        "held_out": None, "ignored": None, "further": [], "loss": "squares", "resume": None
    }  # fmt: skip
    spans = ("--held-out", "10:", "--ignore", "0.5:1", "--ignore", "2:2.5", "--loss", "huber")
    assert run("diagnose", sample("lift"), *spans).exit_code == 0
    assert settings[1]["loss"] == "huber"
    time = asked[1].time
    assert (settings[1]["held_out"] == (time >= 10)).all()
    between = ((time >= 0.5) & (time <= 1)) | ((time >= 2) & (time <= 2.5))
    assert (settings[1]["ignored"] == between).all()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--ignore", "5"), "expected FROM:TO in seconds"),
        (("--held-out", "much"), "expected a fraction between 0 and 1"),
        (("absent.csv",), "no recording 'absent.csv'"),
        (("--card", "absent.toml"), "no card 'absent.toml'"),
        (("--out", "taken"), "is not a folder"),
        (("--nonsense",), "No such option"),
    ],
)
def test_bad_input(
    run: Run, tmp_path: Path, asked: list[Recording], arguments: tuple[str, ...], told: str
) -> None:
    (tmp_path / "taken").write_text("")
    outcome = run("diagnose", *arguments)
    assert outcome.exit_code == 2
    assert told in outcome.stderr and "Traceback" not in outcome.stderr
    assert outcome.stdout == "" and asked == []
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


@pytest.mark.parametrize("debug", [False, True])
def test_a_fault_of_ours(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, debug: bool) -> None:
    def diagnose(*_: Any, **__: Any) -> None:
        raise RuntimeError("a surprise")

    monkeypatch.setattr(package, "diagnose", diagnose)
    outcome = run("diagnose", *(["--debug"] if debug else []))
    assert outcome.exit_code == 1
    assert "RuntimeError: a surprise" in outcome.stderr and "Please report it" in outcome.stderr
    assert ("Traceback" in outcome.stderr) is debug
    assert outcome.stdout == "" and list(tmp_path.iterdir()) == []


def test_a_standard_error_that_takes_no_more_leaves_the_exit_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a full disk to which messages are sent."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("jaxmuscle.cli.console.typer.echo", refused)
    with pytest.raises(typer.Exit) as ended, faults(debug=False):
        raise InputError("no such file")
    assert ended.value.exit_code == BAD_INPUT


def test_effects_lists_the_whole_catalogue(run: Run) -> None:
    outcome = run("effects")
    assert outcome.exit_code == 0
    lines = [line.split() for line in outcome.stdout.splitlines()]
    assert [[e.name, e.slot.name] for e in (*CATALOGUE, *FURTHER)] == [
        words[:2] for words in lines if len(words) > 1 and words[0] in BY_NAME
    ]
    assert all(f"\n{kind}_COLUMN " in outcome.stdout for kind in KINDS)
    assert ":math:" not in outcome.stdout


def test_help_needs_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "from jaxmuscle.cli import app\n"
        "try:\n    app(['--help'])\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        "print([name for name in ('jax', 'numpy', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert "diagnose" in done.stdout and "effects" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def test_version(run: Run) -> None:
    outcome = run("--version")
    assert outcome.exit_code == 0
    assert outcome.stdout == f"jaxmuscle {jaxmuscle.__version__}\n"


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, Path]:
    """Two tables of one bench, with a card each; the clock of the second one begins at 3 s."""
    lines = sample("lift").read_text(encoding="utf-8").splitlines(keepends=True)
    card = sample("lift").with_suffix(".toml").read_text(encoding="utf-8")
    files = tmp_path / "first.csv", tmp_path / "second.csv"
    for file, rows in zip(files, (lines[1:1501], lines[1501:3501]), strict=True):
        file.write_text("".join([lines[0], *rows]), encoding="utf-8")
        file.with_suffix(".toml").write_text(card, encoding="utf-8")
    return files


def test_several_recordings_of_one_bench(
    run: Run, runs: tuple[Path, Path], asked: list[Recording], settings: list[dict[str, Any]]
) -> None:
    outcome = run(
        "diagnose", *runs, "--ignore", "second:3:3.5", "--held-out", "first:2:", "--held-out", "second"
    )
    assert outcome.exit_code == 0, outcome.stderr
    (whole,), (how,) = asked, settings
    assert [(each.name, each.first, each.rows) for each in whole.members] == [
        ("first", 0, 1500),
        ("second", 1500, 2000),
    ]
    assert whole.breaks == (1500,)
    assert how["ignored"].sum() == 251 and how["ignored"][1500:1751].all()
    assert how["held_out"].sum() == 500 + 2000 and how["held_out"][1000:].all()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--ignore", "3:3.5"), "expected NAME:FROM:TO"),
        (("--held-out", "third"), "these are first, second"),
        (("--held-out", "0.2", "--held-out", "second"), "one fraction, or spans only"),
        (("--held-out", "second:0:1"), "no row of 'second' lies there"),
        (("--card", "first.toml", "--card", "second.toml", "--card", "first.toml"), "one for each; got 3"),
    ],
)
def test_options_that_several_recordings_do_not_take(
    run: Run, runs: tuple[Path, Path], asked: list[Recording], options: tuple[str, ...], told: str
) -> None:
    outcome = run("diagnose", *runs, *options)
    assert outcome.exit_code == 2 and told in outcome.stderr and asked == []


@pytest.mark.slow
def test_one_card_for_all(run: Run, runs: tuple[Path, Path], asked: list[Recording]) -> None:
    runs[1].with_suffix(".toml").unlink()
    assert run("diagnose", *runs, "--card", "first.toml").exit_code == 0
    assert len(asked[0]) == 3500


def test_cards_with_another_weight(run: Run, runs: tuple[Path, Path], asked: list[Recording]) -> None:
    card = runs[1].with_suffix(".toml")
    card.write_text(card.read_text(encoding="utf-8").replace("value = 8,", "value = 9,"), encoding="utf-8")
    assert run("diagnose", *runs).exit_code == 0
    (whole,) = asked
    assert [whole.differing(each) for each in whole.members] == [{"mass": 8.0}, {"mass": 9.0}]


def test_cards_that_say_different_things(run: Run, runs: tuple[Path, Path]) -> None:
    card = runs[1].with_suffix(".toml")
    text = card.read_text(encoding="utf-8")
    card.write_text(text.replace("value = 8,", "value = 9, std = 0.5,"), encoding="utf-8")
    outcome = run("diagnose", *runs)
    assert outcome.exit_code == 2
    assert "differ in [known] mass" in outcome.stderr and "jaxmuscle fit" in outcome.stderr
