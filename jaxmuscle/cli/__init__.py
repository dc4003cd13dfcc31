"""The command line: parse, call one function, print. What is heavy is imported when it is needed."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

import jaxmuscle
from jaxmuscle.cli.cards import check, init
from jaxmuscle.cli.compare import compare
from jaxmuscle.cli.console import BAD_INPUT, FAULT, INTERRUPTED, WIDE
from jaxmuscle.cli.simulation_subcommands import simulate, tune
from jaxmuscle.cli.subcommands import diagnose, effects, fit, sweep

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

    After Ctrl-C it ends at once: at an ordinary end Python would wait for threads in which XLA is at work.
    """
    try:
        app()
    except SystemExit as end:
        if end.code != INTERRUPTED:
            raise
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(INTERRUPTED)


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
