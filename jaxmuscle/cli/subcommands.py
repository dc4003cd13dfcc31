"""Commands `diagnose`, `fit`, `effects` and `sweep`."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer
from rich.table import Table

from jaxmuscle._config import configure
from jaxmuscle.cli.checkpoint_file import Resume, checkpoint_beside
from jaxmuscle.cli.console import faults, list_files, output, progress
from jaxmuscle.cli.own_modules import load_modules
from jaxmuscle.cli.shared_options import (
    CardArgument,
    Cards,
    Debug,
    Every,
    Ignore,
    Modules,
    Resample,
    Stretch,
)
from jaxmuscle.errors import InputError
from jaxmuscle.progress import interruptible

if TYPE_CHECKING:
    from jaxmuscle.diagnosis.result import Diagnosis
    from jaxmuscle.effects import AbstractEffect
    from jaxmuscle.estimation import FitResult
    from jaxmuscle.recordings import Recording


Loss: TypeAlias = Annotated[
    str,
    typer.Option(
        help="What fits make small: squares, or huber or student, under which stretches with large errors "
        "that no model explains (a blow, a jammed guide) pull less."
    ),
]


def diagnose(
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Tables of recordings (.csv, .xlsx, .tdms, …) of one bench, each a run of its own; the "
            "sample 'lift' when not given."
        ),
    ] = None,
    card: Cards = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results; jaxmuscle-NAME of the first recording when not given."),
    ] = None,
    held_out: Annotated[
        list[str] | None,
        typer.Option(
            help="What is kept for the last word: a fraction of each recording, at its end, or FROM:TO in "
            "seconds of its clock; of several recordings NAME:FROM:TO, or NAME for all of one. What the card "
            "holds out, else 0.3, when not given. Spans may be given several times."
        ),
    ] = None,
    ignore: Ignore = None,
    loss: Loss = "squares",
    report: Annotated[bool, typer.Option(help="Write the page report.html.")] = True,
    resample: Resample = False,
    stretch: Stretch = None,
    every: Every = None,
    resume: Resume = False,
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Find what the declared model lacks, fit it, and report.

    Writes result.json, card.toml and report.html; prints the errors before and after and one sentence.
    Effects of a --module are sought beside those of the catalogue.
    """
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
        from jaxmuscle.diagnosis import diagnose as run
        from jaxmuscle.recordings.joining import of_one_bench
        from jaxmuscle.recordings.readers import table_name
        from jaxmuscle.recordings.spans import held_out_part, rows_within
        from jaxmuscle.report.report_files import writable_folder, write
        from jaxmuscle.samples import sample

        own = load_modules(module)
        files = recordings or [sample("lift")]
        folder = Path(f"jaxmuscle-{table_name(files[0])}") if out is None else out
        # Better now than after a minute of work.
        writable_folder(folder)
        names = ", ".join(file.name for file in files)
        tell(f"reading {names}" + ("" if recordings else ", the sample that comes with jaxmuscle"))
        given = of_one_bench(read_all(files, card, resample=resample, stretch=stretch, every=every))
        kept = held_out_part(given, held_out, "--held-out") if held_out else None
        ignored = rows_within(given, ignore, "--ignore") if ignore else None
        asked = {"held_out": kept, "ignored": ignored, "further": own, "loss": loss, "progress": tell}
        with checkpoint_beside(folder, resume) as checkpoint:
            found = run(given, **asked, resume=checkpoint)
            tell("writing the results")
            written = write(found, folder, report=report)
    _print_outcome(found, written)


def read_all(files: Sequence[Path], cards: Sequence[Path] | None, **rows: Any) -> list[Recording]:
    """The recordings of several tables; what is not taken of one is told.

    Args:
        cards: none (each has its own beside it), one for all, or one for each.
        rows: which rows to take, as of :func:`jaxmuscle.read`.

    Raises:
        InputError: another number of cards; what :func:`jaxmuscle.read` says of table or card.
    """
    cards = cards or []
    if len(cards) not in (0, 1, len(files)):
        raise InputError(
            f"expected one --card for all of {len(files)} recordings, or one for each; got {len(cards)}"
        )
    each = cards if len(cards) == len(files) else [cards[0] if cards else None] * len(files)
    return [taken(file, card, **rows) for file, card in zip(files, each, strict=True)]


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


Free: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="What to fit: a quantity of the card, a path, offset.COLUMN, start.STATE (the state at the "
        "first sample); what is uncertain if not given."
    ),
]


def fit(
    recordings: Annotated[
        list[Path], typer.Argument(help="Tables of recordings (.csv, .xlsx, .tdms, …) of one rig.")
    ],
    card: Cards = None,
    free: Free = None,
    per_recording: Annotated[
        list[str] | None, typer.Option(help="What to fit with one value for each recording.")
    ] = None,
    profile: Annotated[list[str] | None, typer.Option(help="Parameter whose profile is computed.")] = None,
    loss: Loss = "squares",
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
    ignore: Ignore = None,
    resample: Resample = False,
    stretch: Stretch = None,
    every: Every = None,
    resume: Resume = False,
    module: Modules = None,
    debug: Debug = False,
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
        from jaxmuscle.recordings.spans import rows_of_each
        from jaxmuscle.report.report_files import writable_folder, write_fit

        load_modules(module)
        folder = Path(f"jaxmuscle-{table_name(recordings[0])}-fit") if out is None else out
        writable_folder(folder)
        found = read_all(recordings, card, resample=resample, stretch=stretch, every=every)
        asked = {
            "free": free or None,
            "loss": loss,
            "noise": "estimated" if estimate_noise else None,
            "starts": starts,
            "per_recording": per_recording or (),
            "profiles": profile or (),
            "budget": budget,
            "seed": seed,
            "masks": rows_of_each(found, ignore, "--ignore") if ignore else None,
            "progress": tell,
        }
        actuator = actuator_from_card(found[0].card)
        with checkpoint_beside(folder, resume) as kept:
            result = interruptible(lambda: run(actuator, found, **asked, resume=kept), stop=lambda: None)
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


def effects(module: Modules = None, debug: Debug = False) -> None:
    """List the effects that a diagnosis tries: name, signal, rigs that offer it, meaning, source.

    Below them those that it tries where these leave something, with errors of the sensor of any COLUMN, and
    at last those that only a card or ``catalogue=`` names, and those of a --module.
    """
    with faults(debug):
        import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
        from jaxmuscle.effects import CATALOGUE, DECLARABLE, EXTENSION
        from jaxmuscle.effects.readings import KINDS
        from jaxmuscle.formatting import meaning

        own = load_modules(module)
        output().print(_listed(CATALOGUE))
        output().print("\nWhere these leave something:\n")
        more = _listed(EXTENSION)
        for kind, effect in KINDS.items():
            more.add_row(f"{kind}_COLUMN", "COLUMN_reading", "all", meaning(effect.__doc__), effect.source)
        output().print(more)
        output().print("\nDeclared by a card, or named in diagnose(catalogue=...):\n")
        output().print(_listed(DECLARABLE))
        if own:
            output().print("\nYour own:\n")
            output().print(_listed(own))


def _listed(effects: Iterable[type[AbstractEffect]]) -> Table:
    from jaxmuscle.actuators import RIGS
    from jaxmuscle.formatting import meaning

    table = Table("name", "signal", "rigs", "meaning", "source", box=None, pad_edge=False)
    table.columns[0].no_wrap = table.columns[1].no_wrap = True
    for effect in effects:
        rigs = ", ".join(name for name, rig in RIGS.items() if rig.offers(effect))
        table.add_row(effect.name, effect.slot.name, rigs, meaning(effect.__doc__), effect.source)
    return table


def sweep(
    card: CardArgument,
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
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Simulate a machine at many operating points.

    Writes a dataset in SI (pressures absolute) and a picture in the units of the card.
    """
    with faults(debug):
        configure(compile_cache=True)
        from jaxmuscle.cli.swept_files import swept_files

        load_modules(module)
        kept = None if runs else reduce or ["maximum", "span"]
        target = Path(f"{card.stem}-sweep.nc") if out is None else out
        files, note = swept_files(
            card, over, command, settings or [], kept, output or None, duration, step, target, picture,
            memory, scheduler,
        )  # fmt: skip
    if note:
        typer.echo(f"jaxmuscle: {note}", err=True)
    list_files(files)
