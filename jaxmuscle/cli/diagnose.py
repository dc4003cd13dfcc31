"""The command `diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from jaxmuscle.cli.faults import faults
from jaxmuscle.cli.shown import list_files, output, progress
from jaxmuscle.configuration import configure

if TYPE_CHECKING:
    from jaxmuscle.diagnosis.result import Diagnosis


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
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
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
    output().print(table)
    typer.echo(f"\n{sentence(found)}\n")
    list_files(files)
