"""How far a sweep is and how long it still takes, on standard error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

Tell = Callable[[int, int], None]
"""Called with the points done and all points."""
LINES = 10
"""Lines at most where there is no terminal."""


@contextmanager
def shown(progress: bool | Tell, total: int) -> Iterator[Callable[[int], None]]:
    """A function to be given the number of points that have just been done.

    Args:
        progress: a function of (done, total); or whether to show a bar with the remaining time in a
            terminal, a line each tenth elsewhere.
        total: number of points that are to be computed.
    """
    done = 0
    with _told(progress, total) as tell:

        def add(points: int) -> None:
            nonlocal done
            done += points
            tell(done, total)

        yield add


@contextmanager
def _told(progress: bool | Tell, total: int) -> Iterator[Tell]:
    if callable(progress):
        yield progress
    elif not progress:
        yield lambda done, total: None
    else:
        console = Console(stderr=True)
        yield from _bar(console, total) if console.is_terminal else _lines(console)


def _bar(console: Console, total: int) -> Iterator[Tell]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    parts = (TextColumn("points"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*parts, console=console) as bar:
        task = bar.add_task("points", total=total)
        yield lambda done, total: bar.update(task, completed=done)


def _lines(console: Console) -> Iterator[Tell]:
    begun, told = time.monotonic(), 0

    def tell(done: int, total: int) -> None:
        nonlocal told
        parts = done * LINES // total
        if parts <= told:
            return
        told = parts
        left = (time.monotonic() - begun) * (total - done) / done
        console.print(f"{done} of {total} points, {left:.0f} s left", highlight=False, soft_wrap=True)

    yield tell
