"""Console output: results on standard output, progress on standard error, messages and exit statuses of
faults.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer
from rich.console import Console

from jaxmuscle.errors import InputError
from jaxmuscle.files import abandon
from jaxmuscle.progress import Progress, in_words

FAULT, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit status when the program is at fault, when the input is, and after Ctrl-C."""

INTERRUPTION = "jaxmuscle: interrupted"
_shown: list[Callable[[], None]] = []
"""What takes a bar from the terminal that is shown there."""
_advice: list[str] = []
"""What is said behind :data:`INTERRUPTION`."""
_speaking = threading.Lock()
"""Held while a line of progress is printed, and from the last message of the program on."""
LAST_LINE = 1.0
"""Seconds to wait at the end for a line that is being printed: nobody may be reading it."""


@contextmanager
def resumable() -> Iterator[None]:
    """Have a Ctrl-C within the block say that the same command goes on."""
    _advice.append("; the same command goes on where it was")
    yield
    _advice.clear()  # After an exception :func:`faults` has still to say it.


def _interruption() -> str:
    return "".join((INTERRUPTION, *_advice))


def end_by_interrupt(told: bool) -> NoReturn:
    """End the process after Ctrl-C, with the terminal as it was and no file half-written.

    `told`: whether :data:`INTERRUPTION` has been printed.
    """
    abandon()
    for hide in _shown:
        hide()
    # The work is still going on in its thread: its next line must not come into this one or after it.
    _speaking.acquire(timeout=LAST_LINE)
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        if not told:
            sys.stderr.write(f"{_interruption()}\n")
            sys.stderr.flush()
    os._exit(INTERRUPTED)


@contextmanager
def printable() -> Iterator[None]:
    """Turn a refusal to take what is printed (a full disk, a reader that is gone) into an exit status."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer goes nowhere; Python would try once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno != errno.EPIPE:
            _tell_fault(f"jaxmuscle: cannot print the results: {error.strerror}")
        raise SystemExit(BAD_INPUT) from error


def _tell_fault(text: str) -> None:
    """Print a message; where standard error takes no more, the exit status alone tells."""
    with contextlib.suppress(OSError):
        typer.echo(text, err=True)


@contextmanager
def faults(debug: bool) -> Iterator[None]:
    """Turn exceptions into a message and an exit status."""
    _advice.clear()
    try:
        yield
    except InputError as error:
        if debug:
            traceback.print_exc()
        _tell_fault(f"jaxmuscle: {error}")
        raise typer.Exit(BAD_INPUT) from error
    except (KeyboardInterrupt, typer.Abort) as error:
        _tell_fault(_interruption())
        raise typer.Exit(INTERRUPTED) from error
    except Exception as error:
        # Files are told by InputError: what is left is a standard output that takes no more.
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EPIPE):
            raise
        if debug:
            traceback.print_exc()
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        advice = "" if debug else " and the output of the same command with --debug"
        _tell_fault(f"jaxmuscle: a fault of the program, not of your input: {what}")
        _tell_fault(f"Please report it with your recording's card{advice}.")
        raise typer.Exit(FAULT) from error


WIDE = 150
"""Columns of a table that goes to a file or another program."""
HEARTBEAT = 10.0
"""Seconds of silence after which a line tells that the work goes on, where there is no terminal."""
Tell = Callable[[Progress | str], None]


def output() -> Console:
    """Standard output, for tables of texts that may contain brackets."""
    wide = None if sys.stdout.isatty() else WIDE
    return Console(width=wide, markup=False, highlight=False)


def list_files(files: Iterable[Path]) -> None:
    """The files that were written, a line each."""
    for file in files:
        typer.echo(str(file))


@contextmanager
def progress() -> Iterator[Tell]:
    """Tell what is going on: a bar in a terminal, a line each elsewhere. Standard error only."""
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    with (_bar if console.is_terminal else _lines)(console) as tell:
        yield tell


@contextmanager
def _bar(console: Console) -> Iterator[Tell]:
    """A bar with a fraction and the time left for a :class:`Progress`, a spinner for a text."""
    from rich.progress import BarColumn, SpinnerColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Display

    parts = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(bar_width=24),
             TaskProgressColumn(), TextColumn("{task.fields[left]}"))  # fmt: skip
    with Display(*parts, console=console, transient=True) as display:
        task = display.add_task("", total=None, left="")

        def tell(now: Progress | str) -> None:
            if isinstance(now, Progress):
                left = f"about {in_words(now.seconds_left)} left"
                display.update(task, description=now.doing, total=1.0, completed=now.fraction, left=left)
            else:
                display.update(task, description=now)

        _shown.append(display.stop)
        try:
            yield tell
        finally:
            _shown.clear()


@contextmanager
def _lines(console: Console) -> Iterator[Tell]:
    """A line for each new thing that is done and each tenth, and where there was none for some seconds."""
    ended, begin, told, tenths = threading.Event(), time.monotonic(), time.monotonic(), 0
    last, seen = "", set[str]()

    def tell(now: Progress | str) -> None:
        nonlocal told, tenths, last
        doing, fraction = (now.doing, now.fraction) if isinstance(now, Progress) else (now, 0.0)
        if doing in seen and int(10 * fraction + 1e-9) <= tenths:
            return
        seen.add(doing)
        last, told, tenths = str(now), time.monotonic(), int(10 * fraction + 1e-9)
        with _speaking:
            console.print(last)

    def beat() -> None:
        nonlocal told
        while not ended.wait(0.5):
            if time.monotonic() - told > HEARTBEAT:
                told = time.monotonic()
                with _speaking:
                    console.print(f"… {in_words(told - begin)} so far; {last}")

    threading.Thread(target=beat, daemon=True, name="heartbeat").start()
    try:
        yield tell
    finally:
        ended.set()
