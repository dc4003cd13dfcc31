"""The command `fit`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from jaxmuscle.cli.faults import faults
from jaxmuscle.cli.shown import list_files, output, progress
from jaxmuscle.configuration import configure
from jaxmuscle.errors import InputError
from jaxmuscle.interruptible import interruptible

if TYPE_CHECKING:
    from jaxmuscle.estimation import FitResult


def fit(
    recordings: Annotated[list[Path], typer.Argument(help="Tables of recordings (.csv, .mat) of one rig.")],
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
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Fit what the cards call uncertain to one or more recordings.

    Writes result.json and card.toml; prints the values and what has to be known about them.
    """
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
        from jaxmuscle.estimation import fit as run
        from jaxmuscle.recordings import actuator_from_card, read
        from jaxmuscle.report.fit_files import write_fit
        from jaxmuscle.report.write import writable_folder

        folder = Path(f"jaxmuscle-{recordings[0].stem}-fit") if out is None else out
        writable_folder(folder)
        cards = card or []
        if cards and len(cards) != len(recordings):
            raise InputError(f"expected a --card for each of {len(recordings)} recordings; got {len(cards)}")
        found = [
            read(file, cards[i] if cards else None, resample=resample) for i, file in enumerate(recordings)
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
