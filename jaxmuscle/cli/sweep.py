"""The command `sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxmuscle.cli.faults import faults
from jaxmuscle.cli.shown import list_files
from jaxmuscle.configuration import configure


def sweep(
    card: Annotated[Path, typer.Argument(help="Card of the machine (.toml).")],
    over: Annotated[
        list[str],
        typer.Option(
            help="What to sweep, in the unit of the card: NAME=FROM:TO:N[:log][:UNIT] or "
            "NAME=VALUE,VALUE[:UNIT]. Several span a grid. NAME: a quantity of the card, a path, "
            "or command.PARAMETER."
        ),
    ],
    command: Annotated[str, typer.Option(help="Command: sine, step, pulse or ramp.")] = "sine",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Another value than the card's: NAME=VALUE[:UNIT].")
    ] = None,
    reduce: Annotated[
        list[str] | None,
        typer.Option(
            help="What to keep of a run: maximum, minimum, span, mean, rms, final, settling_time, overshoot, "
            "bandwidth, gain, phase. Maximum and span when not given."
        ),
    ] = None,
    runs: Annotated[bool, typer.Option("--runs", help="Keep the whole runs.")] = False,
    output: Annotated[list[str] | None, typer.Option(help="Readings to keep; all when not given.")] = None,
    duration: Annotated[float, typer.Option(help="Length of a run [s].")] = 2.0,
    step: Annotated[float | None, typer.Option(help="Sampling step [s]; the rig's when not given.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Result: .nc (NetCDF), or .zarr, which is taken up again after an interruption."),
    ] = None,
    picture: Annotated[bool, typer.Option(help="Draw the result beside it (.png).")] = True,
    memory: Annotated[float, typer.Option(help="Limit of memory [GiB].")] = 1.0,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask scheduler whose workers compute the sweep.")
    ] = None,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Simulate a machine at many operating points.

    Writes a dataset in SI (pressures absolute) and a picture in the units of the card.
    """
    with faults(debug):
        configure(compile_cache=True)
        from jaxmuscle.report.sweep_files import swept_files

        kept = None if runs else reduce or ["maximum", "span"]
        target = Path(f"{card.stem}-sweep.nc") if out is None else out
        files, note = swept_files(
            card, over, command, settings or [], kept, output or None, duration, step, target, picture,
            memory, scheduler,
        )  # fmt: skip
    if note:
        typer.echo(f"jaxmuscle: {note}", err=True)
    list_files(files)
