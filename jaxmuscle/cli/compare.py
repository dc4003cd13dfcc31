"""Command `compare`: several diagnoses side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from jaxmuscle.cli.console import faults, list_files, output
from jaxmuscle.cli.own_modules import load_modules
from jaxmuscle.cli.shared_options import Debug, Modules


def compare(
    diagnoses: Annotated[
        list[Path],
        typer.Argument(help="Folders that diagnose wrote, their result.json, or saved diagnoses."),
    ],
    out: Annotated[Path, typer.Option(help="Page to write (.html).")] = Path("jaxmuscle-comparison.html"),
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Put diagnoses side by side: verdicts, effects, errors on unseen data, values.

    Prints a table and writes a page.
    """
    with faults(debug):
        from jaxmuscle.report.comparison import compared, read_outcomes
        from jaxmuscle.report.report_files import placed, writable_folder

        load_modules(module)
        writable_folder(out.parent)
        found = compared(read_outcomes(diagnoses))
        files = placed({out.name: found.page()}, out.parent)
    table = Table("", *found.labels, "", box=None, pad_edge=False)
    table.add_row("verdict", *found.verdicts, "")
    for rows in found.sections.values():
        table.add_row("")
        for row in rows:
            table.add_row(row.name, *row.entries, row.remark and f"{row.remark} apart")
    output().print(table)
    typer.echo()
    list_files(files)
