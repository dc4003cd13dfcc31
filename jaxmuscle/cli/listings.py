"""Listings of `jaxmuscle init`: the rigs, the quantities of one, and the types that have data sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer
from rich.table import Table

from jaxmuscle.cli.console import output

if TYPE_CHECKING:
    from jaxmuscle.recordings.schema import Rig


def list_rigs(rigs: dict[str, Any]) -> None:
    """Print the rigs and the columns of each."""
    from jaxmuscle.recordings import schema
    from jaxmuscle.recordings.typical import rig_in_words

    table = Table("rig", "what it is", "columns", box=None, pad_edge=False)
    for name, rig in rigs.items():
        table.add_row(name, rig_in_words(rig), ", ".join(schema.columns(rig)))
    output().print(table)
    typer.echo("\nThe quantities of one: jaxmuscle init --rig NAME --list")


def list_rig(rig: Rig) -> None:
    """Print the columns and quantities of a rig, with typical values."""
    from jaxmuscle.recordings import schema
    from jaxmuscle.recordings.typical import card_unit, default_in_card, meaning_in_card, typical
    from jaxmuscle.units import example_unit

    typer.echo("Columns of its table:\n")
    table = Table("column", "unit", box=None, pad_edge=False)
    for name, need in schema.columns(rig).items():
        kind = ", gauge or absolute" if need.referenced else ""
        table.add_row(name, f"such as {example_unit(need.unit) or 'a number'}{kind}")
    output().print(table)
    typer.echo("\nQuantities of its card:\n")
    table = Table("quantity", "unit", "typical", "of", "meaning", box=None, pad_edge=False)
    for name, need in schema.quantities(rig).items():
        usual, taken = typical(name, need), default_in_card(rig, name)
        value, source = ("—", "") if usual is None else (usual.number, usual.source)
        reference = " gauge"
        if taken is not None:
            value, source, reference = f"{taken[0]:g}", "taken when not given", " absolute"
        unit = card_unit(name, need) + (reference if need.referenced else "")
        table.add_row(name, unit, value, source, meaning_in_card(need))
    output().print(table)


def list_types() -> None:
    """Print the types that have data sheets, what a card takes from each, and where that is stated."""
    from jaxmuscle.recordings.data_sheets import all_sources, data_sheets, name_in_cards

    sources = all_sources()
    for part, sheets in data_sheets().items():
        typer.echo(f"[{part}]\n")
        table = Table("type", "quantity", "value", "", "sources", box=None, pad_edge=False)
        for sheet in sheets.values():
            for field, q in sheet.quantities.items():
                table.add_row(
                    sheet.type,
                    name_in_cards(part, field),
                    str(q),
                    "derived" if q.derived else "stated",
                    ", ".join(str(sources.index(source) + 1) for source in q.sources),
                )
        output().print(table)
        typer.echo("")
    typer.echo("Sources:\n")
    for number, source in enumerate(sources, 1):
        typer.echo(f"{number}  {source}")
    typer.echo(
        '\nIn a card: type = "…" in [muscle] or [valve]. What the card gives itself goes before. How the '
        "rest is derived stands in the reference of cards."
    )
