"""The blocks of a sweep on this machine, a thread for each core.

XLA runs a batch on one core. Threads that call the one compiled function keep all cores busy, without the
setting of host devices that JAX only takes before it starts; on two cores both ways had two threads at
work all the time and took the same.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed

from jaxmuscle.cores import cores
from jaxmuscle.sweeps.job import Job, default_devices
from jaxmuscle.sweeps.sinks import Sink


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
