"""The command line: parse, call one function, print. What is heavy is imported when it is needed."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

import jaxmuscle
from jaxmuscle.errors import InputError

if TYPE_CHECKING:
    from jaxmuscle.diagnosis.result import Diagnosis

FAULT, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit status when the program is at fault, when the input is, and after Ctrl-C."""
WIDE = 150
"""Columns of a table that goes to a file or another program."""

app = typer.Typer(
    help="Find out what a model of a pneumatic muscle lacks, from a recording of the real machine.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Entry point of the program."""
    app()


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


@app.command()
def diagnose(
    recording: Annotated[
        Path | None,
        typer.Argument(help="Table of a recording (.csv, .mat); the sample 'lift' when not given."),
    ] = None,
    card: Annotated[
        Path | None, typer.Option(help="Card of the recording; the .toml of the same stem when not given.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; jaxmuscle-NAME when not given.")
    ] = None,
    report: Annotated[bool, typer.Option(help="Write the page report.html.")] = True,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring an irregular clock to a uniform one.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Find what the declared model lacks, fit it, and report.

    Writes result.json, card.toml and report.html; prints the errors before and after and one sentence.
    """
    with _faults(debug), _progress() as tell:
        tell("loading")
        from jaxmuscle.diagnosis import diagnose as run
        from jaxmuscle.recordings import read
        from jaxmuscle.report.write import writable_folder, write
        from jaxmuscle.samples import sample

        file = sample("lift") if recording is None else recording
        folder = Path(f"jaxmuscle-{file.stem}") if out is None else out
        # Better now than after a minute of work.
        writable_folder(folder)
        tell(f"reading {file.name}" + (", the sample that comes with jaxmuscle" if recording is None else ""))
        found = run(read(file, card, resample=resample), progress=tell)
        tell("writing the results")
        files = write(found, folder, report=report)
    _print_outcome(found, files)


@app.command()
def effects() -> None:
    """List the effects that a diagnosis tries: name, signal, rigs that offer it, meaning, source."""
    from jaxmuscle.actuators import RIGS
    from jaxmuscle.effects import CATALOGUE
    from jaxmuscle.report.words import meaning

    table = Table("name", "signal", "rigs", "meaning", "source", box=None, pad_edge=False)
    table.columns[0].no_wrap = table.columns[1].no_wrap = True
    for effect in CATALOGUE:
        rigs = ", ".join(name for name, rig in RIGS.items() if effect.reads <= rig.available)
        table.add_row(effect.name, effect.slot.name, rigs, meaning(effect.__doc__), effect.source)
    _output().print(table)


def _print_outcome(found: Diagnosis, files: list[Path]) -> None:
    from jaxmuscle.report import tables
    from jaxmuscle.report.sentence import sentence

    table = Table("column", box=None, pad_edge=False, title="Error on unseen data", title_justify="left")
    heads = ("before", "after") if found.effects else ("error",)
    for head in (*heads, "sensor noise"):
        table.add_column(head, justify="right")
    for row in tables.errors(found):
        before = [row["held_out_before"]] if found.effects else []
        table.add_row(row["column"], *before, row["held_out_after"], row["noise"])
    output = _output()
    output.print(table)
    typer.echo(f"\n{sentence(found)}\n")
    for file in files:
        typer.echo(str(file))


def _output() -> Console:
    """Standard output, for tables of texts that may contain brackets."""
    wide = None if sys.stdout.isatty() else WIDE
    return Console(width=wide, markup=False, highlight=False)


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Tell what is going on: one changing line in a terminal, a line each elsewhere. Standard error only."""
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    if not console.is_terminal:
        yield console.print
        return
    with console.status("") as status:
        yield lambda text: status.update(text)


@contextmanager
def _faults(debug: bool) -> Iterator[None]:
    """Turn exceptions into a message and an exit status."""
    try:
        yield
    except InputError as error:
        if debug:
            traceback.print_exc()
        typer.echo(f"jaxmuscle: {error}", err=True)
        raise typer.Exit(BAD_INPUT) from error
    except KeyboardInterrupt as error:
        raise typer.Exit(INTERRUPTED) from error
    except Exception as error:
        if debug:
            traceback.print_exc()
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        advice = "" if debug else " and the output of the same command with --debug"
        typer.echo(f"jaxmuscle: a fault of the program, not of your input: {what}", err=True)
        typer.echo(f"Please report it with your recording's card{advice}.", err=True)
        raise typer.Exit(FAULT) from error


if __name__ == "__main__":
    main()
