"""Work side by side in threads: XLA's programs and compiler let other threads run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from jaxmuscle._config import cores

Task = TypeVar("Task")
Result = TypeVar("Result")


def on_all_cores(function: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
    """`function` of every task, as many side by side as there are cores; of a single one in this thread.

    Threads are made anew each time, which takes 0.1 ms: of one pool for all, a task that divides its own work
    again would wait for threads that wait for it.
    After an error or a Ctrl-C, tasks that have not begun are dropped, and the others are not waited for.
    """
    if len(tasks) == 1:
        return [function(tasks[0])]
    pool = ThreadPoolExecutor(min(cores(), max(1, len(tasks))), thread_name_prefix="jaxmuscle")
    try:
        return list(pool.map(function, tasks))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def in_background(function: Callable[[], Result]) -> Future[Result]:
    """`function` in a thread of its own; `result()` waits for what it gives, or raises its error."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="jaxmuscle-ahead")
    try:
        return pool.submit(function)
    finally:
        pool.shutdown(wait=False)
