"""Commands `diagnose`, `fit`, `effects` and `sweep`."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from jaxmuscle._config import configure
from jaxmuscle.cli.console import faults, list_files, output, progress
from jaxmuscle.errors import InputError
from jaxmuscle.progress import interruptible

if TYPE_CHECKING:
    from jaxmuscle.diagnosis.result import Diagnosis
    from jaxmuscle.estimation import FitResult
    from jaxmuscle.recordings import Recording


def diagnose(
    recording: Annotated[
        Path | None,
        typer.Argument(
            help="Table of a recording (.csv, .xlsx, .tdms, …); the sample 'lift' when not given."
        ),
    ] = None,
    card: Annotated[
        Path | None, typer.Option(help="Card of the recording; the .toml of the same stem when not given.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; jaxmuscle-NAME when not given.")
    ] = None,
    held_out: Annotated[
        str,
        typer.Option(
            help="What is kept for the last word: a fraction of the recording, at its end, or FROM:TO in "
            "seconds of its clock."
        ),
    ] = "0.3",
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            help="FROM:TO in seconds of the recording's clock, where readings count for nothing (a slack "
            "muscle, a saturated sensor). May be given several times."
        ),
    ] = None,
    report: Annotated[bool, typer.Option(help="Write the page report.html.")] = True,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring an irregular clock to a uniform one.")
    ] = False,
    stretch: Annotated[
        str | None,
        typer.Option(
            help="Rows to take, FROM:TO in seconds of the recording's clock, or all; of a long recording the "
            "stretch that moves most when not given."
        ),
    ] = None,
    every: Annotated[int | None, typer.Option(help="Take one of so many samples.")] = None,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Find what the declared model lacks, fit it, and report.

    Writes result.json, card.toml and report.html; prints the errors before and after and one sentence.
    """
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
        from jaxmuscle.diagnosis import diagnose as run
        from jaxmuscle.recordings.readers import table_name
        from jaxmuscle.recordings.spans import fraction, rows_within
        from jaxmuscle.report.report_files import writable_folder, write
        from jaxmuscle.samples import sample

        file = sample("lift") if recording is None else recording
        folder = Path(f"jaxmuscle-{table_name(file)}") if out is None else out
        # Better now than after a minute of work.
        writable_folder(folder)
        tell(f"reading {file.name}" + (", the sample that comes with jaxmuscle" if recording is None else ""))
        given = taken(file, card, resample=resample, stretch=stretch, every=every)
        kept = rows_within(given, [held_out], "--held-out") if ":" in held_out else fraction(held_out)
        ignored = rows_within(given, ignore, "--ignore") if ignore else None
        found = run(given, held_out=kept, ignored=ignored, progress=tell)
        tell("writing the results")
        files = write(found, folder, report=report)
    _print_outcome(found, files)


def taken(file: Path, card: Path | None, **rows: Any) -> Recording:
    """The recording in a file; what was not taken of it is told."""
    from jaxmuscle.recordings import read
    from jaxmuscle.recordings.row_selection import LongRecording

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LongRecording)
        found = read(file, card, **rows)
    if found.left_out:
        typer.echo(f"jaxmuscle: {found.left_out}", err=True)
    return found


def _print_outcome(found: Diagnosis, files: list[Path]) -> None:
    from jaxmuscle.report import tables
    from jaxmuscle.report.sentence import sentence

    table = Table("column", box=None, pad_edge=False, title="Error on unseen data", title_justify="left")
    heads = ("before", "after") if found.added else ("error",)
    for head in (*heads, "sensor noise"):
        table.add_column(head, justify="right")
    for row in tables.errors(found):
        before = [row["held_out_before"]] if found.added else []
        table.add_row(row["column"], *before, row["held_out_after"], row["noise"])
    output().print(table)
    typer.echo(f"\n{sentence(found)}\n")
    list_files(files)


def fit(
    recordings: Annotated[
        list[Path], typer.Argument(help="Tables of recordings (.csv, .xlsx, .tdms, …) of one rig.")
    ],
    card: Annotated[
        list[Path] | None,
        typer.Option(help="Card of a recording, in their order; the .toml of the same stem when not given."),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="What to fit: a quantity of the card, a path, offset.COLUMN, start.STATE (the state at the "
            "first sample); what is uncertain if not given."
        ),
    ] = None,
    per_recording: Annotated[
        list[str] | None, typer.Option(help="What to fit with one value for each recording.")
    ] = None,
    profile: Annotated[list[str] | None, typer.Option(help="Parameter whose profile is computed.")] = None,
    loss: Annotated[str, typer.Option(help="squares, huber or student.")] = "squares",
    estimate_noise: Annotated[
        bool, typer.Option("--estimate-noise", help="Take the noise from the residuals, not from the card.")
    ] = False,
    starts: Annotated[int, typer.Option(help="Starts, spread over the priors.")] = 4,
    budget: Annotated[
        float | None, typer.Option(help="Seconds after which the best so far is taken.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the random starts.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; jaxmuscle-NAME-fit when not given.")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring an irregular clock to a uniform one.")
    ] = False,
    stretch: Annotated[
        str | None,
        typer.Option(
            help="Rows to take, FROM:TO in seconds of the recording's clock, or all; of a long recording the "
            "stretch that moves most when not given."
        ),
    ] = None,
    every: Annotated[int | None, typer.Option(help="Take one of so many samples.")] = None,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Fit what the cards call uncertain to one or more recordings.

    Writes result.json and card.toml; prints the values and what has to be known about them.
    """
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
        from jaxmuscle.estimation import fit as run
        from jaxmuscle.recordings import actuator_from_card
        from jaxmuscle.recordings.readers import table_name
        from jaxmuscle.report.report_files import writable_folder, write_fit

        folder = Path(f"jaxmuscle-{table_name(recordings[0])}-fit") if out is None else out
        writable_folder(folder)
        cards = card or []
        if cards and len(cards) != len(recordings):
            raise InputError(f"expected a --card for each of {len(recordings)} recordings; got {len(cards)}")
        found = [
            taken(file, cards[i] if cards else None, resample=resample, stretch=stretch, every=every)
            for i, file in enumerate(recordings)
        ]
        asked = {
            "free": free or None,
            "loss": loss,
            "noise": "estimated" if estimate_noise else None,
            "starts": starts,
            "per_recording": per_recording or (),
            "profiles": profile or (),
            "budget": budget,
            "seed": seed,
            "progress": tell,
        }
        actuator = actuator_from_card(found[0].card)
        result = interruptible(lambda: run(actuator, found, **asked), stop=lambda: None)
        tell("writing the results")
        files = write_fit(result, folder)
    _print_fit(result, files)


def _print_fit(result: FitResult, files: list[Path]) -> None:
    from jaxmuscle.estimation.summary import RESIDUALS, VALUES, residual_rows, rows

    console = output()
    table = Table(*VALUES, box=None, pad_edge=False)
    for row in rows(result):
        table.add_row(*row)
    console.print(table)
    table = Table(*RESIDUALS, box=None, pad_edge=False)
    for row in residual_rows(result):
        table.add_row(*row)
    typer.echo()
    console.print(table)
    typer.echo("\n" + "\n".join(result.notes()) + "\n")
    list_files(files)


def effects() -> None:
    """List the effects that a diagnosis tries: name, signal, rigs that offer it, meaning, source.

    Below them those that it tries where these leave something, with errors of the sensor of any COLUMN, and
    at last those that only a card or ``catalogue=`` names.
    """
    import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
    from jaxmuscle.actuators import RIGS
    from jaxmuscle.effects import CATALOGUE, DECLARABLE, EXTENSION, AbstractEffect
    from jaxmuscle.effects.readings import KINDS
    from jaxmuscle.formatting import meaning

    def listed(effects: Iterable[type[AbstractEffect]]) -> Table:
        table = Table("name", "signal", "rigs", "meaning", "source", box=None, pad_edge=False)
        table.columns[0].no_wrap = table.columns[1].no_wrap = True
        for effect in effects:
            rigs = ", ".join(name for name, rig in RIGS.items() if rig.offers(effect))
            table.add_row(effect.name, effect.slot.name, rigs, meaning(effect.__doc__), effect.source)
        return table

    output().print(listed(CATALOGUE))
    output().print("\nWhere these leave something:\n")
    more = listed(EXTENSION)
    for kind, effect in KINDS.items():
        more.add_row(f"{kind}_COLUMN", "COLUMN_reading", "all", meaning(effect.__doc__), effect.source)
    output().print(more)
    output().print("\nDeclared by a card, or named in diagnose(catalogue=...):\n")
    output().print(listed(DECLARABLE))


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
        from jaxmuscle.cli.swept_files import swept_files

        kept = None if runs else reduce or ["maximum", "span"]
        target = Path(f"{card.stem}-sweep.nc") if out is None else out
        files, note = swept_files(
            card, over, command, settings or [], kept, output or None, duration, step, target, picture,
            memory, scheduler,
        )  # fmt: skip
    if note:
        typer.echo(f"jaxmuscle: {note}", err=True)
    list_files(files)
