"""The option `--resume`, and the file in which it keeps what a diagnosis or a fit has finished."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from jaxmuscle.cli.console import resumable

if TYPE_CHECKING:
    from jaxmuscle.estimation.checkpoint import Checkpoint

Resume: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Keep what is finished in a file beside the folder of the results, FOLDER.checkpoint.json, so "
        "that the same command goes on where an interrupted one was. It is removed when the results are "
        "written.",
    ),
]
ENDING = ".checkpoint.json"


@contextmanager
def checkpoint_beside(folder: Path, wanted: bool) -> Iterator[Checkpoint | None]:
    """A checkpoint beside a folder, which is removed when the block has written the results; or none.

    In the folder where there is one, unless the file is beside it already: more than the folder need not be
    writable.
    """
    if not wanted:
        yield None
        return
    from jaxmuscle.estimation.checkpoint import Checkpoint

    place = folder.parent / f"{folder.name}{ENDING}"
    if folder.is_dir() and not place.exists():
        place = folder / ENDING.removeprefix(".")
    with resumable():
        checkpoint = Checkpoint(place, lambda text: typer.echo(f"jaxmuscle: {text}", err=True))
        try:
            yield checkpoint
        finally:
            checkpoint.close()
        checkpoint.remove()
