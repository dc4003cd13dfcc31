"""What a command shows: results on standard output, what is going on on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

WIDE = 150
"""Columns of a table that goes to a file or another program."""


def output() -> Console:
    """Standard output, for tables of texts that may contain brackets."""
    wide = None if sys.stdout.isatty() else WIDE
    return Console(width=wide, markup=False, highlight=False)


def list_files(files: Iterable[Path]) -> None:
    """The files that were written, a line each."""
    for file in files:
        typer.echo(str(file))


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Tell what is going on: one changing line in a terminal, a line each elsewhere. Standard error only."""
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    if not console.is_terminal:
        yield console.print
        return
    with console.status("") as status:
        yield lambda text: status.update(text)
