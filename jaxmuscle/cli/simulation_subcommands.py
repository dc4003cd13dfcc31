"""Commands `simulate` and `tune`: what a card's machine does under commands, and a controller for it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxmuscle._config import configure
from jaxmuscle.cli.console import faults, list_files, progress
from jaxmuscle.cli.own_modules import load_modules
from jaxmuscle.cli.shared_options import Debug, Modules


def simulate(
    card: Annotated[Path, typer.Argument(help="Card of the machine (.toml).")],
    command: Annotated[
        Path,
        typer.Option(
            help="Table of commands: time and the commands, in columns and units as the card has them."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            help="Table of readings (.csv), in columns and units of the card; CARD-simulated.csv when not "
            "given."
        ),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw the table beside it (.png).")] = False,
    start: Annotated[
        list[str] | None,
        typer.Option(
            help="State at the first sample, else at rest: NAME=VALUE[:UNIT[:gauge|absolute]], NAME a column "
            "of the card, such as pressure, or a state, such as velocity. May be given several times."
        ),
    ] = None,
    substeps: Annotated[
        int | None, typer.Option(help="Steps between two samples; the rig's when not given.")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Relative error of a step, for steps under error control.")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring an irregular clock to a uniform one.")
    ] = False,
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Simulate a machine under commands of your own.

    Writes a table with commands and readings that the card describes like a recording.
    """
    with faults(debug):
        configure(compile_cache=True)
        from jaxmuscle.cli.simulated_files import simulated_files

        load_modules(module)
        target = Path(f"{card.stem}-simulated.csv") if output is None else output
        files = simulated_files(
            card, command, target, start or [], substeps, tolerance, plot=plot, resample=resample
        )
    list_files(files)


def tune(
    card: Annotated[Path, typer.Argument(help="Card of the machine (.toml).")],
    reference: Annotated[
        list[Path],
        typer.Option(
            help="Table of what the reading is to be: time and the reading, in columns and units as the card "
            "has them; straight lines lead from row to row. May be given several times."
        ),
    ],
    controller: Annotated[
        str,
        typer.Option(
            help="What is tuned: pid, feedforward (the model's own inverse and a pid), lqg (designed on the "
            "linearised model first), fuzzy, sliding-mode (of a joint), force (of a jet pipe)."
        ),
    ] = "pid",
    held_out: Annotated[
        list[Path] | None,
        typer.Option(help="Reference for the last word; those that are tuned on when not given."),
    ] = None,
    payload: Annotated[
        list[str] | None,
        typer.Option(
            help="Values of a parameter over which the gains have to hold, in the unit of the card: "
            "NAME=VALUE,VALUE[:UNIT]. Several span a grid."
        ),
    ] = None,
    objective: Annotated[
        list[str] | None,
        typer.Option(
            help="What is made small, TERM=SIZE[:UNIT], a SIZE that costs one: tracking, peak, overshoot, "
            "settling, arrival, effort, variation, sensitivity. Tracking, 1 % of the references' range, when "
            "not given."
        ),
    ] = None,
    gain: Annotated[
        list[str] | None,
        typer.Option(
            help="Gain to begin with, NAME=VALUE[:UNIT], in SI without a unit; guessed when not given."
        ),
    ] = None,
    start: Annotated[
        list[str] | None,
        typer.Option(
            help="State at the first sample, as for simulate; when not given the machine has come to rest "
            "under the command of no output."
        ),
    ] = None,
    sample_time: Annotated[
        float | None, typer.Option(help="Of the controller [s]; the step of the reference when not given.")
    ] = None,
    draws: Annotated[
        int,
        typer.Option(
            help="Machines drawn from what the card is unsure of, to tune on beside its own, and as many "
            "others for the last word."
        ),
    ] = 4,
    starts: Annotated[int, typer.Option(help="Starts, spread about the first gains.")] = 8,
    steps: Annotated[int, typer.Option(help="Most steps of a start.")] = 50,
    budget: Annotated[
        float | None, typer.Option(help="Seconds of search after which the best so far is taken.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of starts, noise and draws.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; jaxmuscle-NAME-tune when not given.")
    ] = None,
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Tune a controller for a machine by gradient descent through the simulated loop.

    Writes gains.toml, report.html and commands.csv; prints gains and errors, on held-out scenarios too.
    """
    with faults(debug), progress() as tell:
        tell("loading")
        configure(compile_cache=True)
        from jaxmuscle.cli.tuned_files import Request, tuned_files

        load_modules(module)
        asked = Request(
            card, controller, reference, held_out or (), payload or (), objective or (), gain or (),
            start or (), sample_time, draws, starts, steps, budget, seed,
        )  # fmt: skip
        folder = Path(f"jaxmuscle-{card.stem}-tune") if out is None else out
        found, files = tuned_files(asked, folder, tell)
    typer.echo(f"{found}\n")
    list_files(files)
