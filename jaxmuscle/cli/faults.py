"""From what went wrong to a message and an exit status."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from jaxmuscle.errors import InputError

FAULT, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit status when the program is at fault, when the input is, and after Ctrl-C."""


@contextmanager
def faults(debug: bool) -> Iterator[None]:
    """Turn exceptions into a message and an exit status."""
    try:
        yield
    except InputError as error:
        if debug:
            traceback.print_exc()
        typer.echo(f"jaxmuscle: {error}", err=True)
        raise typer.Exit(BAD_INPUT) from error
    except KeyboardInterrupt as error:
        typer.echo("jaxmuscle: interrupted", err=True)
        raise typer.Exit(INTERRUPTED) from error
    except Exception as error:
        if debug:
            traceback.print_exc()
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        advice = "" if debug else " and the output of the same command with --debug"
        typer.echo(f"jaxmuscle: a fault of the program, not of your input: {what}", err=True)
        typer.echo(f"Please report it with your recording's card{advice}.", err=True)
        raise typer.Exit(FAULT) from error
