"""A sweep in a store: the same numbers, taken up again where it was, nothing computed twice."""

import time

import numpy as np
import pytest
import xarray as xr
from sweeps.conftest import CLOCK, REDUCTIONS

import jaxmuscle as jm
from jaxmuscle.sweeps.job import Job
from jaxmuscle.sweeps.store import Store

OVER = {"mass": np.linspace(1, 20, 12), "command.frequency": np.geomspace(1, 20, 30)}
BLOCKS = 4
SLOW = 0.5
"""Seconds that a block waits, so that an interruption finds some that have not begun."""


@pytest.fixture
def computed(monkeypatch):
    """Numbers of the blocks that were computed; all but the first one slowly, as blocks of a large sweep."""
    numbers, compute = [], Job.compute

    def slowly(job, number):
        numbers.append(number)
        time.sleep(SLOW if number else 0)
        return compute(job, number)

    monkeypatch.setattr(Job, "compute", slowly)
    return numbers


@pytest.fixture
def options(sine):
    return {"command": sine, "times": CLOCK, "reductions": REDUCTIONS}


@pytest.fixture(scope="module")
def in_memory(machine, sine):
    return jm.sweep(machine, OVER, command=sine, times=CLOCK, reductions=REDUCTIONS)


def interrupt_after(points):
    def progress(done, total):
        if done >= points:
            raise KeyboardInterrupt

    return progress


def test_store_and_memory_are_equal_to_the_last_bit(machine, options, in_memory, tmp_path):
    found = jm.sweep(machine, OVER, **options, store=tmp_path / "sweep.zarr")
    assert found.load().identical(in_memory)
    with xr.open_zarr(tmp_path / "sweep.zarr", consolidated=False) as again:
        assert again.load().equals(in_memory)
        assert again.pressure_maximum.encoding["chunks"] == Store(tmp_path / "sweep.zarr").block_shape(
            again.attrs["jaxmuscle_sweep"]
        )


def test_whole_runs(machine, sine, tmp_path):
    options = {"command": sine, "times": CLOCK, "outputs": ["position"]}
    over = {"mass": [1.0, 2.0, 3.0]}
    found = jm.sweep(machine, over, **options, store=tmp_path / "runs.zarr")
    assert found.load().identical(jm.sweep(machine, over, **options))
    assert found.position.dims == ("mass", "time")


def test_an_interrupted_sweep_goes_on_where_it_was(machine, options, in_memory, tmp_path, computed):
    place = tmp_path / "sweep.zarr"
    with pytest.raises(KeyboardInterrupt):
        jm.sweep(machine, OVER, **options, store=place, progress=interrupt_after(1))
    first = Store(place).times_written()
    assert len(first) == BLOCKS and 1 <= first.sum() < BLOCKS
    assert sorted(computed) == list(np.flatnonzero(first))
    told = []
    found = jm.sweep(machine, OVER, **options, store=place, progress=lambda *now: told.append(now))
    assert sorted(computed) == list(range(BLOCKS))
    np.testing.assert_array_equal(Store(place).times_written(), 1)
    assert found.load().identical(in_memory)
    assert told[-1][0] == told[-1][1] < 360


def test_a_whole_sweep_is_not_computed_again(machine, options, in_memory, tmp_path, computed):
    jm.sweep(machine, OVER, **options, store=tmp_path / "sweep.zarr")
    again = jm.sweep(machine, OVER, **options, store=tmp_path / "sweep.zarr")
    assert len(computed) == BLOCKS
    assert again.load().identical(in_memory)


@pytest.mark.slow
def test_another_memory_limit_goes_on_all_the_same(machine, options, tmp_path, computed):
    place = tmp_path / "sweep.zarr"
    with pytest.raises(KeyboardInterrupt):
        jm.sweep(machine, OVER, **options, store=place, progress=interrupt_after(1))
    jm.sweep(machine, OVER, **options, store=place, memory=16_000)
    assert sorted(computed) == list(range(BLOCKS))


@pytest.mark.parametrize("change", ["values", "times", "machine", "command", "reductions", "names"])
def test_another_sweep_is_refused(machine, sine, options, tmp_path, change):
    place, over = tmp_path / "sweep.zarr", OVER
    jm.sweep(machine, over, **options, store=place)
    if change == "values":
        over = {**OVER, "mass": OVER["mass"] * (1 + 1e-15)}
    elif change == "machine":
        machine = jm.replace(machine, {"valve.area": 1.2e-6})
    elif change == "names":
        over = {"load.mass": OVER["mass"], "command.frequency": OVER["command.frequency"]}
    else:
        other = {
            "times": CLOCK + 0.1,
            "command": jm.commands.Sine(amplitude=2.0, mean=1.0, frequency=5.0, phase=0.1),
            "reductions": ("minimum", "final"),
        }
        options = {**options, change: other[change]}
    with pytest.raises(jm.InputError, match=r"is another sweep; choose another place, or delete it"):
        jm.sweep(machine, over, **options, store=place)


def test_a_function_with_another_body_is_another_sweep(machine, tmp_path):
    place, over = tmp_path / "sweep.zarr", {"command.level": [1.0, 2.0]}

    def sweep_with(factor):
        return jm.sweep(machine, over, command=lambda t, level: level * t * factor, times=CLOCK, store=place)

    sweep_with(2.0)
    sweep_with(2.0)
    with pytest.raises(jm.InputError, match="another sweep"):
        sweep_with(3.0)


def test_other_things_are_not_overwritten(machine, options, tmp_path):
    (tmp_path / "notes.txt").write_text("keep")
    xr.Dataset({"a": ("x", [1.0])}).to_zarr(tmp_path / "other.zarr", consolidated=False)
    for place, what in [(tmp_path, "no Zarr store"), (tmp_path / "other.zarr", "holds no sweep")]:
        with pytest.raises(jm.InputError, match=what):
            jm.sweep(machine, OVER, **options, store=place)
    assert (tmp_path / "notes.txt").read_text() == "keep"
