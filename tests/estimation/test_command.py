"""`jaxmuscle fit`: what it prints, what it writes, how it ends."""

import json

import equinox as eqx
import pandas as pd
import pytest
from estimation.made import pulled
from typer.testing import CliRunner

import jaxmuscle as jm
from jaxmuscle.cli import app


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with two recordings and their cards."""
    folder = tmp_path_factory.mktemp("bench")
    for seed, name in enumerate(("first", "second")):
        recording = pulled(seed, name=name)
        table = pd.DataFrame({"time": recording.time, **recording.columns})
        table.to_csv(folder / f"{name}.csv", index=False)
        (folder / f"{name}.toml").write_text(recording.card.to_toml(), encoding="utf-8")
    return folder


def run(*arguments):
    return CliRunner().invoke(app, ["fit", *map(str, arguments)])


@pytest.fixture(scope="module")
def outcome(bench):
    return run(
        bench / "first.csv", bench / "second.csv", "--out", bench / "out", "--starts", 2,
        "--per-recording", "offset.force", "--profile", "end_factor", "--free", "end_factor",
    )  # fmt: skip


def test_it_prints_and_writes(outcome, bench):
    assert outcome.exit_code == 0, outcome.stderr
    assert sorted(p.name for p in (bench / "out").iterdir()) == [
        "card-second.toml",
        "card.toml",
        "result.json",
    ]
    for name in ("end_factor", "offset.force[first]", "offset.force[second]", "The fit converged"):
        assert name in outcome.stdout
    assert str(bench / "out" / "result.json") in outcome.stdout.splitlines()
    assert "cost" in outcome.stderr and "cost" not in outcome.stdout


def test_the_files_can_be_read_back(outcome, bench):
    result = jm.FitResult.load(bench / "out" / "result.json")
    assert list(result.cards) == ["first", "second"]
    assert [curve.name for curve in result.profiles] == ["end_factor"]
    card = jm.Card.read(bench / "out" / "card.toml")
    assert eqx.tree_equal(jm.actuator(card), result.actuator)
    assert json.loads((bench / "out" / "result.json").read_text())["code"] == "converged"
    assert outcome.exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["absent.csv"], "no recording 'absent.csv'"),
        (["first.csv", "--free", "endfactor"], "did you mean 'end_factor'"),
        (["first.csv", "--loss", "cubes"], "loss: unknown 'cubes'"),
        (
            ["first.csv", "second.csv", "first.csv", "--card", "first.toml", "--card", "first.toml"],
            "expected one --card for all of 3 recordings, or one for each; got 2",
        ),
        (["first.csv", "--out", "first.csv"], "is not a folder"),
        ([], "Missing argument"),
    ],
)
def test_bad_input(bench, monkeypatch, arguments, told):
    monkeypatch.chdir(bench)
    before = sorted(bench.iterdir())
    outcome = run(*arguments)
    assert outcome.exit_code == 2
    assert told in outcome.stderr and "Traceback" not in outcome.stderr
    assert outcome.stdout == "" and sorted(bench.iterdir()) == before


def test_help_tells_what_can_be_fitted():
    told = run("--help").output
    assert "offset.COLUMN" in told and "start.STATE" in told
