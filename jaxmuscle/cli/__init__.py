"""The command line: parse, call one function, print. What is heavy is imported when it is needed."""

from __future__ import annotations

import signal
from typing import Annotated

import typer

import jaxmuscle
from jaxmuscle.cli.cards import check, init
from jaxmuscle.cli.compare import compare
from jaxmuscle.cli.console import BAD_INPUT, FAULT, INTERRUPTED, WIDE, end_by_interrupt, printable
from jaxmuscle.cli.simulation_subcommands import simulate, tune
from jaxmuscle.cli.subcommands import diagnose, effects, fit, sweep
from jaxmuscle.progress import interruptible

__all__ = [
    "BAD_INPUT",
    "FAULT",
    "INTERRUPTED",
    "WIDE",
    "app",
    "check",
    "compare",
    "diagnose",
    "effects",
    "fit",
    "init",
    "main",
    "options",
    "simulate",
    "sweep",
    "tune",
]

app = typer.Typer(
    help="Find out what a model of a pneumatic muscle lacks, from a recording of the real machine.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Entry point of the program.

    The commands run in a thread of their own, while this one listens for Ctrl-C: reading a long table and
    compiling hear nothing of it. After Ctrl-C the program ends at once, whatever is under way; an ordinary
    end of Python would wait for threads in which XLA is at work.
    """
    try:
        with printable():
            interruptible(app, stop=lambda: None)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # A second Ctrl-C must not disturb the end.
        end_by_interrupt(told=False)
    except SystemExit as end:
        # What was asked for is done; Ctrl-C during Python's own end would look like a fault.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if end.code != INTERRUPTED:
            raise
        end_by_interrupt(told=True)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"jaxmuscle {jaxmuscle.__version__}")
        raise typer.Exit()


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Find out what a model of a pneumatic muscle lacks, from a recording of the real machine."""


# In the order in which the help lists them.
app.command()(diagnose)
app.command()(init)
app.command()(check)
app.command()(compare)
app.command()(fit)
app.command()(effects)
app.command()(simulate)
app.command()(sweep)
app.command()(tune)
