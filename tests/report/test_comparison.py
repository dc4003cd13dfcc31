"""Diagnoses side by side: what the table says, and what is told of input that is none."""

import html
import json
from pathlib import Path

import pytest
from report.chromium import opened
from report.fake import diagnosis
from typer.testing import CliRunner

from jaxmuscle.cli import BAD_INPUT, app
from jaxmuscle.errors import InputError
from jaxmuscle.report.comparison import compared, read_outcomes
from jaxmuscle.report.report_files import write


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of three diagnoses."""
    root = tmp_path_factory.mktemp("outcomes")
    verdicts = ("effects found", "complete", "not confirmed")
    places = [root / f"jaxmuscle-{verdict.replace(' ', '-')}" for verdict in verdicts]
    for verdict, place in zip(verdicts, places, strict=True):
        write(diagnosis(verdict), place, report=False)
    return places


def run(*arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of `jaxmuscle compare`."""
    done = CliRunner().invoke(app, ["compare", *map(str, arguments)])
    return done.exit_code, done.stdout, done.stderr


def test_the_rows_say_what_the_results_say(folders: list[Path]) -> None:
    found = compared(read_outcomes(folders))
    assert found.labels == ("effects-found", "complete", "not-confirmed")
    assert found.verdicts == ("effects found", "complete", "not confirmed")
    rows = {(title, row.name): row for title, rows in found.sections.items() for row in rows}
    friction = rows["Effects", "load friction"].entries
    assert friction == ("force 16.2 ± 0.4 N", "–", "force 16.2 ± 0.4 N (not confirmed)")
    position = rows["Error on unseen data", "position"].entries
    assert position == ("605 µm → 31 µm (1.0 × noise)", "30 µm (0.99 × noise)", "605 µm (20 × noise)")
    assert rows["Parameters", "valve area"].entries[0] == "1.171 ± 0.003 mm²"
    assert rows["Parameters", "valve area"].remark == "0.0 σ"
    assert rows["Parameters", "load friction: force"].entries[1] == "–"


def test_values_that_differ_are_told_in_standard_deviations(folders: list[Path], tmp_path: Path) -> None:
    said = json.loads((folders[0] / "result.json").read_text(encoding="utf-8"))
    area = said["parameters"]["valve_area"]
    area["value"] += 5 * area["std"]
    said["parameters"]["end_factor"]["std"] = None
    other = tmp_path / "other.json"
    other.write_text(json.dumps(said), encoding="utf-8")
    rows = {row.name: row for row in compared(read_outcomes([folders[0], other])).sections["Parameters"]}
    assert rows["valve area"].remark == f"{5 / 2**0.5:.1f} σ"
    assert rows["end factor"].remark == "" and rows["end factor"].entries[1] == "1.291"


def test_folders_files_and_saved_diagnoses_are_the_same(folders: list[Path], tmp_path: Path) -> None:
    saved = diagnosis("effects found").save(tmp_path / "whole.json")
    three = compared(read_outcomes([folders[0], folders[0] / "result.json", saved]))
    assert three.labels == ("effects-found (1)", "effects-found (2)", "whole (3)")
    for rows in three.sections.values():
        assert all(len(set(row.entries)) == 1 for row in rows)


def test_the_command_prints_a_table_and_writes_a_page(folders: list[Path], tmp_path: Path) -> None:
    page = tmp_path / "side.html"
    status, printed, _ = run(*folders, "--out", page)
    assert status == 0 and str(page) in printed and "force 16.2 ± 0.4 N" in printed
    text = html.unescape(page.read_text(encoding="utf-8"))
    assert "3 diagnoses side by side" in text and "not-confirmed" in text
    assert "<script" not in text and "http" not in text.replace("http-equiv", "")


def test_the_page_is_readable_on_a_phone(folders: list[Path], tmp_path: Path) -> None:
    file = tmp_path / "side.html"
    file.write_text(compared(read_outcomes(folders)).page(), encoding="utf-8")
    with opened(file, viewport={"width": 400, "height": 900}) as shown:
        assert shown.evaluate("() => document.documentElement.scrollWidth") <= 400


def test_labels_are_escaped(folders: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "<b>bold"
    write(diagnosis("complete"), other, report=False)
    assert "<b>bold" not in compared(read_outcomes([folders[0], other])).page()


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{not json", "cannot be read as JSON"),
        ("[]", "not the outcome of a diagnosis but something else"),
        ('{"kind": "jaxmuscle fit"}', "not the outcome of a diagnosis but a file of 'jaxmuscle fit'"),
        ('{"verdict": "complete", "effects": 3}', "expected the result.json of jaxmuscle diagnose"),
    ],
)
def test_files_that_are_none_end_with_status_2(
    content: str, told: str, folders: list[Path], tmp_path: Path
) -> None:
    wrong, page = tmp_path / "wrong.json", tmp_path / "side.html"
    wrong.write_text(content, encoding="utf-8")
    status, _, message = run(folders[0], wrong, "--out", page)
    assert status == BAD_INPUT and told in " ".join(message.split()) and not page.exists()


def test_what_is_missing_is_told(folders: list[Path], tmp_path: Path) -> None:
    assert "expected two diagnoses or more" in run(folders[0], "--out", tmp_path / "p.html")[2]
    assert "no result.json in this folder" in run(folders[0], tmp_path, "--out", tmp_path / "p.html")[2]
    status, _, message = run(folders[0], tmp_path / "none", "--out", tmp_path / "p.html")
    assert status == BAD_INPUT and "no outcome of a diagnosis" in message
    with pytest.raises(InputError, match="got 0"):
        read_outcomes([])
    status, _, message = run(*folders, "--out", folders[0])
    assert status == BAD_INPUT and "cannot write" in message
