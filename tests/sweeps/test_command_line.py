"""`jaxmuscle sweep`: from a card to files, in the units of the card."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner, Result

import jaxmuscle as jm
from jaxmuscle.cli import app
from jaxmuscle.samples import sample

CARD = str(sample("lift").with_suffix(".toml"))
SHORT = ("--duration", "0.16", "--set", "command.amplitude=2", "--set", "command.mean=1")

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the program in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, ["sweep", *arguments])


@pytest.mark.slow
def test_a_grid_to_netcdf_and_a_picture(run: Run, tmp_path: Path) -> None:
    outcome = run(CARD, "--over", "mass=1:20:3", "--over", "command.frequency=1:100:3:log", *SHORT)
    assert outcome.exit_code == 0, outcome.stderr
    assert outcome.stdout.splitlines() == ["lift-sweep.nc", "lift-sweep.png"]
    assert "9 of 9 points" in outcome.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lift-sweep.nc", "lift-sweep.png"]
    with xr.open_dataset("lift-sweep.nc") as found:
        np.testing.assert_allclose(found.mass, [1, 10.5, 20])
        np.testing.assert_allclose(found["command.frequency"], [1, 10, 100])
        machine = jm.actuator(jm.read(jm.sample("lift")).card)
        command = jm.commands.Sine(amplitude=2.0, mean=1.0)
        over = {"mass": found.mass.values, "command.frequency": found["command.frequency"].values}
        clock = np.arange(81) * 0.002
        alone = jm.sweep(machine, over, command=command, times=clock, reductions=["maximum", "span"])
        xr.testing.assert_equal(found.load(), alone)
    assert Path("lift-sweep.png").read_bytes().startswith(b"\x89PNG")


def test_units_are_those_of_the_card(run: Run) -> None:
    outcome = run(
        CARD, "--over", "supply_pressure=3:7:2", "--over", "initial_length=250,300", "--set", "mass=4000:g",
        "--runs", "--output", "position", "--out", "runs.zarr", "--no-picture", *SHORT,
    )  # fmt: skip
    assert outcome.exit_code == 0, outcome.stderr
    assert outcome.stdout == "runs.zarr\n"
    with xr.open_zarr("runs.zarr", consolidated=False) as found:
        np.testing.assert_allclose(found.supply_pressure, [401325.0, 801325.0])
        np.testing.assert_allclose(found.initial_length, [0.25, 0.3])
        assert found.position.dims == ("supply_pressure", "initial_length", "time")
        assert '"mass": 4.0' in found.attrs["parameters"]


def test_a_store_is_taken_up_again(run: Run) -> None:
    arguments = (CARD, "--over", "mass=1:20:3", *SHORT, "--out", "a.zarr", "--no-picture")
    assert run(*arguments).exit_code == 0
    again = run(*arguments)
    assert again.exit_code == 0 and "points" not in again.stderr
    other = run(*arguments, "--set", "end_factor=1.2")
    assert other.exit_code == 2 and "is another sweep" in other.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--over", "mas=1:2:3"), "did you mean 'mass'"),
        (("--over", "mass"), "expected NAME=FROM:TO:N"),
        (("--over", "mass=1:2:x"), "the number of values is 'x'"),
        (("--over", "mass=a:2:3"), "could not convert string to float: 'a'"),
        (("--over", "mass=0:2:3:log"), "has to be above zero"),
        (("--over", "mass=1:2:3:psi"), "expected a mass"),
        (("--over", "mass=1:2:3:log:kg:kg"), "do not know what 'kg' is"),
        (("--over", "mass=1,2", "--over", "mass=1,2"), "each name once"),
        (("--over", "mass=1,2", "--set", "mass=1,2"), "one value; got 2"),
        (("--over", "mass=1,2", "--set", "mass=-1"), "has to be above zero; got -1 kg"),
        (("--over", "mass=1,2", "--command", "sinus"), "did you mean 'sine'"),
        (("--over", "mass=1,2", "--reduce", "max"), "unknown 'max'"),
        (("--over", "mass=1,2", "--duration", "0"), "expected 0 < step < duration"),
        (("--over", "mass=1,2", "--out", "a.csv"), "ends in .nc or .zarr"),
        (("--over", "mass=1,2", "--out", "no/a.nc"), "there is no folder"),
        (("--over", "mass=1,2", "--memory", "0.000001"), "raise memory="),
        ((), "Missing option '--over'"),
    ],
)
def test_bad_input(run: Run, tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    outcome = run(CARD, *arguments)
    assert outcome.exit_code == 2, outcome.stderr
    assert told in outcome.stderr and "Traceback" not in outcome.stderr
    assert outcome.stdout == "" and list(tmp_path.iterdir()) == []


def test_commands_of_two_muscles(run: Run) -> None:
    card = str(sample("swing").with_suffix(".toml"))
    outcome = run(
        card, "--over", "inertia=0.01,0.1", "--command", "step", "--set", "command.level=2.8,2.2",
        "--duration", "0.1", "--reduce", "final", "--out", "a.nc",
    )  # fmt: skip
    assert outcome.exit_code == 0, outcome.stderr
    with xr.open_dataset("a.nc") as found:
        assert found.pressure_final.dims == ("inertia", "muscle")
        assert (found.pressure_final[:, 0] > found.pressure_final[:, 1]).all()


@pytest.mark.parametrize("arguments", [["--help"], ["sweep", "--help"], ["--version"]])
def test_help_needs_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        "from jaxmuscle.cli import app\n"
        f"try:\n    app({arguments})\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        "heavy = ('jax', 'numpy', 'matplotlib', 'xarray', 'pandas', 'pint', 'dask', 'zarr')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
