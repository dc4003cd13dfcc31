"""`jaxmuscle diagnose --resume`: where the file is, how long, and what is said."""

from pathlib import Path
from typing import Any

import pytest
from report.fake import diagnosis
from typer.testing import CliRunner

import jaxmuscle.diagnosis as package
from jaxmuscle.cli import BAD_INPUT, INTERRUPTED, app
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.checkpoint import BEGINNING, FORMAT, Checkpoint

GOES_ON = "jaxmuscle: interrupted; the same command goes on where it was"


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path | None]:
    """Where the file was in each diagnosis; all that end by Ctrl-C keep something there first."""
    found: list[Path | None] = []

    def diagnose(recording: Any, *, resume: Checkpoint | None, held_out: Any = None, **how: Any) -> Any:
        found.append(None if resume is None else resume.place)
        if resume is not None:
            resume.open({})
            assert resume.place is not None
            resume.place.write_text(f"{BEGINNING}{FORMAT}}}")
        if held_out is not None:
            raise KeyboardInterrupt
        return diagnosis("effects found")

    monkeypatch.setattr(package, "diagnose", diagnose, raising=False)
    monkeypatch.chdir(tmp_path)
    return found


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["diagnose", "--no-report", *arguments])


def interrupted(*arguments: str) -> Any:
    outcome = run("--held-out", "0.2", *arguments)
    assert outcome.exit_code == INTERRUPTED
    return outcome.stderr.splitlines()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_file_is_beside_the_folder_until_the_results_are_written(
    places: list[Path | None], tmp_path: Path
) -> None:
    assert interrupted("--resume")[-1] == GOES_ON
    assert names(tmp_path) == ["jaxmuscle-lift.checkpoint.json"]
    outcome = run("--resume")
    assert outcome.exit_code == 0, outcome.stderr
    assert "checkpoint.json: it is broken; it is not used" in outcome.stderr
    assert names(tmp_path) == ["jaxmuscle-lift"]
    assert names(tmp_path / "jaxmuscle-lift") == ["card.toml", "result.json"]
    assert places == [Path("jaxmuscle-lift.checkpoint.json")] * 2


def test_without_the_option_nothing_is_written(places: list[Path | None], tmp_path: Path) -> None:
    interrupted("--resume")
    (tmp_path / "jaxmuscle-lift.checkpoint.json").unlink()
    assert interrupted()[-1] == "jaxmuscle: interrupted", "the advice of the command before is gone"
    assert names(tmp_path) == [] and places[-1] is None


def test_it_is_in_a_folder_that_is_there(places: list[Path | None], tmp_path: Path) -> None:
    """Above it nothing may be writable; and a file that is beside it already is taken."""
    (tmp_path / "out").mkdir()
    for out in ("out", "."):
        assert interrupted("--resume", "--out", out)[-1] == GOES_ON
    assert places == [Path("out/checkpoint.json"), Path("checkpoint.json")]
    (tmp_path / "out.checkpoint.json").write_text(f"{BEGINNING}{FORMAT}}}")
    interrupted("--resume", "--out", "out")
    assert places[-1] == Path("out.checkpoint.json")


def test_it_stays_where_the_results_cannot_be_written(
    places: list[Path | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise InputError("cannot write 'result.json': No space left on device")

    monkeypatch.setattr("jaxmuscle.report.report_files.write", full)
    outcome = run("--resume")
    assert outcome.exit_code == BAD_INPUT
    assert "No space left" in outcome.stderr
    assert names(tmp_path) == ["jaxmuscle-lift.checkpoint.json"]


def test_a_place_that_cannot_be_is_told(places: list[Path | None], tmp_path: Path) -> None:
    outcome = run("--resume", "--out", "there/is/none")
    assert outcome.exit_code == BAD_INPUT
    assert "there is no folder" in outcome.stderr and "make it, or name another" in outcome.stderr
    assert names(tmp_path) == []
