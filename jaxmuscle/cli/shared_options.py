"""Options that several commands have, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

CardArgument: TypeAlias = Annotated[Path, typer.Argument(help="Card of the machine (.toml).")]
Cards: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--card",
        help="Card of the recording; the .toml of the same stem when not given. Of several recordings: one "
        "for all, or one for each in their order.",
    ),
]
Ignore: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="FROM:TO in seconds of the recording's clock, where readings count for nothing (a slack "
        "muscle, a saturated sensor); NAME:FROM:TO of one of several recordings. May be given several times, "
        "and adds to what the card ignores."
    ),
]
Resample: TypeAlias = Annotated[
    bool, typer.Option("--resample", help="Bring an irregular clock to a uniform one.")
]
Stretch: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Rows to take, FROM:TO in seconds of the recording's clock, or all; of a long recording the "
        "stretch that moves most when not given."
    ),
]
Every: TypeAlias = Annotated[int | None, typer.Option(help="Take one of so many samples.")]
Modules: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--module",
        help="Python file with rigs and effects of your own, which it registers. May be given several times.",
    ),
]
Debug: TypeAlias = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
