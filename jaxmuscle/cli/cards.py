"""Commands `init` and `check`: a card drafted from a table, and everything that is wrong with a card."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer
from rich.table import Table

from jaxmuscle.cli.console import BAD_INPUT, faults, output
from jaxmuscle.cli.listings import list_rig, list_rigs, list_types
from jaxmuscle.cli.own_modules import load_modules
from jaxmuscle.cli.shared_options import Debug, Every, Modules, Resample, Stretch
from jaxmuscle.errors import InputError

if TYPE_CHECKING:
    from jaxmuscle.recordings.draft import Draft
    from jaxmuscle.recordings.schema import Rig
    from jaxmuscle.recordings.survey import Survey


Settings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="What you know: NAME=VALUE[+-STD][:UNIT[:gauge|absolute]] for a quantity, "
        "NAME=COLUMN[:UNIT[:gauge|absolute]] for a column, muscle=TYPE or valve=TYPE for a bought part "
        "(--types). May be given several times.",
    ),
]


def init(
    recording: Annotated[
        Path | None, typer.Argument(help="Table of a recording (.csv, .xlsx, .tdms, …).")
    ] = None,
    rig: Annotated[
        str | None, typer.Option(help="What kind of machine it is; told by the columns when not given.")
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The card; the .toml of the same name beside the table when not given."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a card that is there.")] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Picture of the columns as they were understood (.png, .svg, .pdf); NAME.columns.png beside "
            "the card NAME.toml when not given."
        ),
    ] = None,
    no_picture: Annotated[bool, typer.Option("--no-picture", help="Draw no picture.")] = False,
    listing: Annotated[
        bool,
        typer.Option("--list", help="Print the columns and quantities of the rig, or all rigs, and end."),
    ] = False,
    types: Annotated[
        bool,
        typer.Option("--types", help="Print the muscles and valves that have data sheets, and end."),
    ] = False,
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Draft the card of a recording.

    Guesses columns, units and gauge or absolute from names and magnitudes; marks what is unsure and what only
    you know.
    """
    with faults(debug):
        from jaxmuscle.actuators import RIGS, rig_named
        from jaxmuscle.files import atomic_write
        from jaxmuscle.recordings.draft import draft_card
        from jaxmuscle.recordings.read import table_in_file
        from jaxmuscle.report.columns_figure import can_be_drawn, draw_columns

        load_modules(module)
        if listing:
            list_rig(rig_named(rig)) if rig else list_rigs(RIGS)
            return
        if types:
            list_types()
            return
        if recording is None:
            raise InputError("expected the table of a recording: jaxmuscle init bench.csv; or --list")
        card = _new_card(recording, out, force)
        _check_picture(picture)
        table, _ = table_in_file(recording)
        draft = draft_card(table, _rig_of(table, rig, RIGS), settings or [])
        draft = _asked(draft) if sys.stdin.isatty() else draft
        drawn = [picture or card.with_suffix(".columns.png")]
        if no_picture or not (picture or can_be_drawn(table, draft.specs)):
            drawn = []
        with atomic_write(card, *drawn) as (file, *unfinished):
            file.write_text(draft.to_toml(recording.name), encoding="utf-8")
            for each in unfinished:
                draw_columns(table, draft.specs, each)
    _print_draft(draft, [card, *drawn])


def _new_card(recording: Path, given: Path | None, force: bool) -> Path:
    """Where the card of a recording goes; `InputError` when it cannot be written there."""
    from jaxmuscle.files import check_place
    from jaxmuscle.recordings.readers import file_of, table_name

    file_of(recording)  # What is no table, such as a folder, may have no name for a card either.
    card = recording.with_name(f"{table_name(recording)}.toml") if given is None else given
    if card.exists() and not force:
        raise InputError(f"{card} is there already; name another with --out, or replace it with --force")
    check_place(card, "--out")
    return card


def _rig_of(table: Any, name: str | None, rigs: dict[str, Any]) -> Rig:
    from jaxmuscle.actuators import rig_named
    from jaxmuscle.recordings.column_guess import guess_rig

    if name is not None:
        return rig_named(name)
    fitting = guess_rig(table, rigs)
    if len(fitting) == 1:
        typer.echo(f"By its columns the rig is {fitting[0]!r}; if it is not, name it with --rig.", err=True)
        return rigs[fitting[0]]
    if fitting and sys.stdin.isatty():
        return rig_named(
            typer.prompt(f"Which rig is it, {' or '.join(fitting)}?", default=fitting[0], err=True)
        )
    found = (
        f"the columns are enough for {' and for '.join(fitting)}" if fitting else "no rig has such columns"
    )
    raise InputError(
        f"{table.file}: which machine is it? {found}. Say --rig NAME, of {', '.join(rigs)}; "
        f"jaxmuscle init --list says what these are. Its columns are {', '.join(table.columns)}"
    )


def _asked(draft: Draft) -> Draft:
    """The draft with what the user answers; an empty answer leaves a quantity open."""
    from jaxmuscle.recordings import schema
    from jaxmuscle.recordings.draft import answered
    from jaxmuscle.recordings.typical import card_unit, meaning_in_card, typical

    needs = schema.quantities(draft.rig)
    names = [name for name in draft.open if name in draft.entries]
    if names:
        typer.echo(
            "What do you know of it? VALUE[+-STD][:UNIT[:gauge|absolute]]; Enter leaves it open.", err=True
        )
    for name in names:
        need, usual = needs[name], typical(name, needs[name])
        such = f", such as {usual}{' gauge' if need.referenced else ''}" if usual else ""
        question = f"{meaning_in_card(need)}, {name} [{card_unit(name, need) or 'a number'}]{such}"
        while answer := typer.prompt(question, default="", show_default=False, err=True).strip():
            try:
                draft = answered(draft, name, answer)
                break
            except InputError as error:
                typer.echo(f"  {error}", err=True)
    return draft


def _print_draft(draft: Draft, written: Sequence[Path]) -> None:
    table = Table("quantity", "column", "unit", "", "guessed from", box=None, pad_edge=False)
    for name, guess in draft.columns.items():
        said = "; ".join(guess.said) or "its name"
        mark = "FILL IN: " if name in draft.open else "" if guess.sure else "CHECK: "
        table.add_row(
            name,
            guess.column or "?",
            guess.unit if guess.unit is not None else "?",
            guess.reference or "",
            mark + said,
        )
    output().print(table)
    open_ones = draft.open
    if draft.unsure:
        typer.echo(f"\nTo be checked in the card: {', '.join(draft.unsure)}.")
    if open_ones:
        typer.echo(f'\nTo be filled in, marked "?" in the card: {", ".join(open_ones)}.')
    typer.echo("\n" + "\n".join(map(str, written)))
    typer.echo(f"{'Then' if open_ones else 'Next'}: jaxmuscle check {written[0]}")


def _check_picture(picture: Path | None) -> None:
    """Raise `InputError` for a picture that cannot be drawn, before anything is written."""
    from jaxmuscle.report.columns_figure import PICTURES

    if picture is not None and picture.suffix.lower() not in PICTURES:
        raise InputError(f"--picture {picture}: expected a file that ends with {', '.join(PICTURES)}")


def check(
    card: Annotated[Path, typer.Argument(help="Card of a recording (.toml).")],
    recording: Annotated[
        Path | None, typer.Option(help="Its table; that of the same name beside the card when not given.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the columns as they are understood (.png, .svg, .pdf).")
    ] = None,
    resample: Resample = False,
    stretch: Stretch = None,
    every: Every = None,
    module: Modules = None,
    debug: Debug = False,
) -> None:
    """Say everything that is wrong with a card and its table, and how they were understood.

    Exit status 0 when nothing is wrong, else 2.
    """
    with faults(debug):
        import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
        from jaxmuscle.recordings.row_selection import request_of
        from jaxmuscle.recordings.survey import survey
        from jaxmuscle.report.columns_figure import draw_columns

        load_modules(module)
        _check_picture(picture)
        found = survey(card, recording, resample=resample, asked=request_of(stretch, every))
        _print_survey(found)
        if picture is not None and found.table is not None and found.card is not None:
            draw_columns(found.table, found.card.columns, picture)
    for fault in found.faults:
        typer.echo(f"jaxmuscle: {fault}", err=True)
    if found.faults:
        raise typer.Exit(BAD_INPUT)
    table = found.table
    typer.echo(f"\nNothing is wrong. Next: jaxmuscle diagnose {table.file if table else ''} --card {card}")


def _print_survey(found: Survey) -> None:
    console = output()
    if found.ranges and found.table is not None:
        typer.echo(f"{found.table.file}:\n")
        table = Table("quantity", "column", "unit", "", box=None, pad_edge=False)
        for head in ("from", "to", "no number"):
            table.add_column(head, justify="right")
        for each in found.ranges:
            ends = ["—" if end is None else f"{end:.5g}" for end in (each.low, each.high)]
            empty = str(each.empty) if each.empty else ""
            table.add_row(
                each.quantity or "(not used)",
                each.column,
                each.unit or "",
                each.reference or "",
                *ends,
                empty,
            )
        console.print(table)
    if (clock := found.sampling) is not None:
        regular = f", {clock.irregular} steps deviate by more than 1 %" if clock.irregular else ", regular"
        typer.echo(
            f"\n{clock.samples} samples in {clock.length:.6g} s, every {1e3 * clock.step:.4g} ms "
            f"({1 / clock.step:.4g} Hz){regular}; longest step {1e3 * clock.longest:.4g} ms"
        )
    for name, count in found.gaps.items():
        typer.echo(f"{name}: {count} samples lie in gaps of its own clock and count for nothing")
    if found.left_out:
        typer.echo(f"\n{found.left_out}")
    if found.card is not None:
        _print_quantities(found.card, console.print)


def _print_quantities(card: Any, show: Callable[[Table], None]) -> None:
    from jaxmuscle.actuators import rig_named
    from jaxmuscle.formatting import words
    from jaxmuscle.recordings import schema
    from jaxmuscle.recordings.card_sections import PAST
    from jaxmuscle.recordings.schema import written_quantity
    from jaxmuscle.recordings.typical import default_in_card, meaning_in_card

    rig, by_sheet = rig_named(card.rig), card.sheet_quantities
    table = Table("quantity", "value", "", "meaning", box=None, pad_edge=False)
    for name, need in schema.quantities(rig).items():
        given = card.quantities.get(name)
        if given is None:
            number, unit = default_in_card(rig, name) or (0.0, "")
            entry = {"value": number, "unit": unit, "reference": "absolute" if need.referenced else ""}
        else:
            entry = written_quantity(given, need, card.ambient_pressure)
        std = f" ± {entry['std']:.6g}" if "std" in entry else ""
        value = f"{entry['value']:.6g}{std} {entry['unit']} {entry.get('reference') or ''}".rstrip()
        role = "not given, taken" if given is None else "to be fitted" if std else "known"
        role += ", data sheet" if name in by_sheet else ""
        table.add_row(name, value, role, meaning_in_card(need))
    typer.echo(f"\nRig {card.rig!r}:\n")
    show(table)
    told = [f"{part} {kind}" for part, kind in card.parts.items()]
    told += [f"effect {name}" for name in card.effects]
    told += [f"noise of {name}" for name in card.noise]
    told += [] if card.horizon is None else [f"horizon {card.horizon:g} s"]
    told += ["windows that begin with what the past tells"] if card.state_from == PAST else []
    told += [f"{words(section)} {', '.join(spans)}" for section, spans in card.row_spans.items() if spans]
    if told:
        typer.echo(f"\nThe card also gives: {', '.join(told)}.")
