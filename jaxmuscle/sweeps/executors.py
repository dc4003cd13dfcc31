"""Executors of a sweep: threads on this machine, one for each core, or workers of a dask cluster.

XLA runs a batch on one core. Threads that call the one compiled function keep all cores busy, without the
setting of host devices that JAX only takes before it starts; on two cores both ways had two threads at
work all the time and took the same.

The job is a task like any other: when the worker that holds it is lost, the scheduler makes it anew. So is a
block that was lost before it was written; one that was written is never computed again.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

from jaxmuscle._config import cores
from jaxmuscle.errors import InputError
from jaxmuscle.sweeps.job import Job, Results, default_devices
from jaxmuscle.sweeps.store import Sink, Store


def compute_here(job: Job, sink: Sink, memory: float, tell: Callable[[int], None]) -> None:
    """Compute the blocks that `sink` lacks; `tell` is given the number of points of each as it is done."""

    def work(number: int) -> int:
        sink.write(number, job.blocks[number], job.compute(number))
        return job.size(number)

    threads = max(1, min(_useful_threads(), int(memory // job.cut.working)))
    pool = ThreadPoolExecutor(threads, thread_name_prefix="sweep")
    try:
        for done in as_completed([pool.submit(work, number) for number in sink.missing(len(job.blocks))]):
            tell(done.result())
    finally:
        # After an error or Ctrl-C the blocks at work end, the others do not begin.
        pool.shutdown(cancel_futures=True)


def _useful_threads() -> int:
    """One a core; two for GPUs, so that one block is written while the next one is computed."""
    if default_devices()[0].platform != "cpu":
        return 2
    return cores()


RETRIES = 3
"""How often a block is tried again after an error."""


def platform_of(client: Any) -> str:
    """Kind of device ("cpu", "gpu") of the workers of a `dask.distributed.Client`, as one of them says.

    Raises:
        InputError: dask is not installed, or `client` is something else.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("client: needs dask; pip install 'jaxmuscle[distributed]'") from error
    if not isinstance(client, Client):
        raise InputError(f"client: expected a dask.distributed.Client; got {type(client).__name__}")
    told: Any = client.submit(_platform, pure=False)
    return told.result()


def compute_on(client: Any, job: Job, sink: Sink, tell: Callable[[int], None]) -> None:
    """Compute the blocks that `sink` lacks; `tell` is given the number of points of each as it is done.

    A store is written by the workers; for any other sink the results come here.
    """
    import cloudpickle
    from distributed import as_completed

    there = sink if isinstance(sink, Store) else None
    shared = client.submit(pickle.loads, cloudpickle.dumps(job), pure=False)
    tasks = client.map(
        _block, sink.missing(len(job.blocks)), job=shared, store=there, pure=False, retries=RETRIES
    )
    try:
        for future, (number, results) in as_completed(tasks, with_results=True):
            if results is not None:
                sink.write(number, job.blocks[number], results)
            tell(job.size(number))
            future.release()
    finally:
        client.cancel(tasks)


def _platform() -> str:
    return default_devices()[0].platform


def _block(number: int, job: Job, store: Store | None) -> tuple[int, Results | None]:
    """One block on a worker: its results, or nothing when they are in the store."""
    if store is None:
        return number, job.compute(number)
    if not store.has(number):
        store.write(number, job.blocks[number], job.compute(number))
    return number, None
