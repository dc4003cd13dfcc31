"""A sweep on a dask cluster: the numbers of one machine, and workers that may be killed."""

import contextlib
import os
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from sweeps.conftest import CLOCK, REDUCTIONS

import jaxmuscle as jm
from jaxmuscle.sweeps.job import Job
from jaxmuscle.sweeps.store import Store

distributed = pytest.importorskip("distributed")

OVER = {"mass": np.linspace(1, 20, 12), "command.frequency": np.geomspace(1, 20, 30)}


@contextlib.contextmanager
def cluster(workers: int, processes: bool, **options) -> Iterator[Any]:
    """A cluster on this machine and its client."""
    with (
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=processes, dashboard_address=None, **options
        ) as machines,
        distributed.Client(machines) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def threads():
    with cluster(2, processes=False) as client:
        yield client


def test_a_cluster_gives_the_numbers_of_one_machine(machine, sine, threads):
    options = {"command": sine, "times": CLOCK, "reductions": REDUCTIONS}
    told = []
    found = jm.sweep(machine, OVER, **options, client=threads, progress=lambda *now: told.append(now))
    assert found.identical(jm.sweep(machine, OVER, **options))
    assert told[-1] == (360, 360) and len(told) == 4


def test_a_cluster_writes_a_store_and_takes_it_up_again(machine, sine, threads, tmp_path, monkeypatch):
    options = {"command": sine, "times": CLOCK, "reductions": REDUCTIONS, "store": tmp_path / "sweep.zarr"}

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jm.sweep(machine, OVER, **options, client=threads, progress=stop)
    before = int(Store(options["store"]).times_written().sum())
    assert 1 <= before <= 4
    found = jm.sweep(machine, OVER, **options, client=threads)
    np.testing.assert_array_equal(Store(options["store"]).times_written(), 1)
    monkeypatch.setattr(Job, "compute", lambda *_: pytest.fail("computed again"))
    jm.sweep(machine, OVER, **options, client=threads)
    monkeypatch.undo()
    del options["store"]
    assert found.load().identical(jm.sweep(machine, OVER, **options))


def test_an_error_of_a_worker_comes_here(machine, sine, threads, monkeypatch):
    def broken(*_):
        raise RuntimeError("a worker's fault")

    monkeypatch.setattr(Job, "compute", broken)
    with pytest.raises(RuntimeError, match="a worker's fault"):
        jm.sweep(machine, OVER, command=sine, times=CLOCK, reductions=REDUCTIONS, client=threads)


def test_other_clients_are_refused(machine):
    with pytest.raises(jm.InputError, match="expected a dask.distributed.Client; got str"):
        jm.sweep(machine, OVER, client="tcp://nowhere:1")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_killed_worker_loses_nothing(machine, sine, tmp_path):
    over = {"mass": np.linspace(1, 20, 64), "command.frequency": np.geomspace(1, 20, 64)}
    options = {"command": sine, "times": np.arange(1000) * 0.002, "reductions": REDUCTIONS}
    place, killed = tmp_path / "sweep.zarr", []
    with cluster(2, processes=True) as client:
        workers = client.run(os.getpid)

        def kill_one(done, total):
            if done >= total // 4 and not killed:
                killed.append(next(iter(workers.values())))
                os.kill(killed[0], signal.SIGKILL)

        found = jm.sweep(machine, over, **options, client=client, store=place, progress=kill_one)
    assert killed
    written = Store(place).times_written()
    assert len(written) == 16
    np.testing.assert_array_equal(written, 1)
    assert found.load().identical(jm.sweep(machine, over, **options))
