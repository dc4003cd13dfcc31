"""Reference of cards: every section and key of every rig, read off the rigs' classes."""

from __future__ import annotations

import ast
import inspect

from docstring_markup import as_markdown
from effect_reference import anchor
from tables import code, table

import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import CATALOGUE, FURTHER
from jaxmuscle.recordings import data_sheets, schema
from jaxmuscle.recordings.card_sections import HEADS, SECTIONS
from jaxmuscle.recordings.schema import CLOCK, Need, Rig
from jaxmuscle.recordings.typical import card_unit, default_in_card, meaning_in_card, rig_in_words, typical
from jaxmuscle.units import KINDS, example_unit

SAID = {
    "rig": "which machine it is, one of the rigs below; before the first section",
    "description": "a text for readers, optional; before the first section",
    "columns": 'quantity → column of the table: `{ column = "p_bar", unit = "bar", reference = "gauge" }`',
    "muscle": '`type = "Festo DMSP-20"`: what the card does not give of the muscle comes from the data sheet '
    "of [this type](#types); what it gives goes before",
    "valve": '`type = "Festo MPYE-5-M5-010-B"`: the same of the valve',
    "known": 'quantities that are held fixed: `{ value = 8, unit = "kg" }`',
    "uncertain": "quantities that are fitted, with one standard deviation of what is known of them: "
    '`{ value = 1.2, std = 0.2, unit = "mm^2" }`',
    "effects": "effects that the machine is known to have, a section each, `[effects.load_friction]`, "
    "with the parameters of [the effect](effects.md); one with a `std` is fitted",
    "noise": "standard deviation of a sensor, by its column; found in the data where it is not given: "
    '`{ value = 0.03, unit = "mm" }`',
    "fit": '`horizon = { value = 1, unit = "s" }`: length of the windows of prediction, each from the '
    'measured state; whole runs when it is not given. `state_from = "past"`: each from the state as samples '
    "up to then tell it, and not those after it, too: for models that are to predict, as a controller's do",
    "ignore": "rows whose readings count for nothing, by names of your own, in times of the table's clock: "
    '`slack = { from = 12, to = 14.5, unit = "s" }`; with `column = "pressure"` of that reading only',
    "held_out": 'rows that no fit of a diagnosis sees: `last_run = { from = 40, unit = "s" }`',
    "breaks": "where a new run begins, with everything that is not measured at rest: "
    '`second_run = { at = 40, unit = "s" }`',
}
"""Key or section of a card → what stands in it."""
SPREADS = ("ANGLE_STD", "END_FACTOR_STD", "SHADOW_STD", "AREA_STD", "LAG_STD")
"""Constants of :mod:`jaxmuscle.recordings.data_sheets` that are standard deviations."""


def card_reference() -> str:
    """The page."""
    parts = [
        "# Cards\n",
        "A card is a TOML file beside the table of a recording that says how the recording was made. This "
        "page is generated from the code that reads cards. `jaxmuscle init --rig NAME --list` prints the "
        "quantities of a rig; [My recording](../how-to/recording.md) shows a whole card.\n",
        "## Sections\n",
        table(
            ("key or section", "what it holds"), [(_named(name), SAID[name]) for name in (*HEADS, *SECTIONS)]
        ),
        "A quantity stands in `[known]` or in `[uncertain]`, not in both; with a `std` it is fitted wherever "
        'it stands. A pressure of the machine says its `reference`, `"gauge"` or `"absolute"`; the ambient '
        "pressure is always absolute. Parameters of effects are differences and have no reference.\n",
        "## Units\n",
        "Any unit that [pint](https://pint.readthedocs.io) reads will do, of the right kind:\n",
        table(
            ("what", "such as", "SI"),
            [(kind, code(usual), code(unit)) for unit, (kind, usual) in KINDS.items() if unit],
        ),
    ]
    return "\n".join([*parts, *_types(), *(_rig(rig) for rig in RIGS.values())])


def _types() -> list[str]:
    """Muscles and valves that have data sheets."""
    rows: list[tuple[str, str, str, str, str]] = []
    sources = data_sheets.all_sources()
    for part, sheets in data_sheets.data_sheets().items():
        for sheet in sheets.values():
            for field, q in sheet.quantities.items():
                name, how = data_sheets.name_in_cards(part, field), "derived" if q.derived else "stated"
                marks = [str(1 + sources.index(source)) for source in q.sources]
                rows.append((code(sheet.type), code(name), str(q), how, ", ".join(marks)))
    return [
        "## Types {#types}\n",
        "What a card takes from the data sheet of a type in `[muscle]` or `[valve]`, where it does not give "
        "it itself; `jaxmuscle init --types` prints the list. A length that is cut to order is in none, nor "
        "is what no source was found for.\n",
        as_markdown(inspect.cleandoc(data_sheets.__doc__ or "").partition("\n\n")[2]) + "\n",
        "Why the standard deviations of what is derived are what they are:\n",
        "\n".join(f"- {_about(name)}" for name in SPREADS) + "\n",
        table(("type", "quantity", "value", "how", "sources"), rows),
        "Sources:\n",
        "\n".join(f"{number}. {source}" for number, source in enumerate(sources, 1)) + "\n",
    ]


def _about(name: str) -> str:
    """What stands below a constant of the data sheets, on one line."""
    nodes = ast.parse(inspect.getsource(data_sheets)).body
    at = next(
        i
        for i, node in enumerate(nodes)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name
    )
    said = nodes[at + 1]
    assert isinstance(said, ast.Expr) and isinstance(said.value, ast.Constant)
    return as_markdown(" ".join(str(said.value.value).split()))


def _named(name: str) -> str:
    return code(name if name in HEADS else f"[{name}]")


def _rig(rig: Rig) -> str:
    quantities = schema.quantities(rig).items()
    offered = [effect for effect in (*CATALOGUE, *FURTHER) if rig.offers(effect)]
    found = ", ".join(f"[`{effect.name}`](effects.md#{anchor(effect)})" for effect in offered)
    return "\n".join(
        [
            f"## Rig `{rig.rig}` {{ #{rig.rig} }}\n",
            f"{rig_in_words(rig)[:1].upper()}{rig_in_words(rig)[1:]}.\n".replace("..", "."),
            "### Columns\n".replace("Columns", f"Columns of `{rig.rig}`"),
            table(
                ("column", "unit", "in `[noise]`", "what"),
                [_column(rig, name, need) for name, need in schema.columns(rig).items()],
            ),
            f"### Quantities of `{rig.rig}`\n",
            table(
                ("quantity", "unit", "typical or taken", "has to be given", "meaning"),
                [_quantity(rig, name, need) for name, need in quantities],
            ),
            f"Effects that it can have: {found}, and errors of the sensor of every measured column.\n",
        ]
    )


def _column(rig: Rig, name: str, need: Need) -> tuple[str, str, str, str]:
    kinds = {CLOCK.name: "clock, uniform"} | dict.fromkeys(
        rig.commands, "command, held until the next sample"
    )
    predicted = name in schema.predicted_columns(rig)
    what = kinds.get(name, "measured, predicted" if predicted else "measured, imposed by the bench")
    reference = ", gauge or absolute" if need.referenced else ""
    noisy = "" if name in kinds else "yes"
    return code(name), f"such as {code(example_unit(need.unit)) or 'a number'}{reference}", noisy, what


def _quantity(rig: Rig, name: str, need: Need) -> tuple[str, str, str, str, str]:
    taken, usual = default_in_card(rig, name), typical(name, need)
    reference = " gauge or absolute" if need.referenced else ""
    if taken is not None:
        value = f"{taken[0]:g} {taken[1]}{' absolute' if need.referenced else ''} when not given"
    else:
        value = "" if usual is None else f"{usual}{' gauge' if need.referenced else ''} ({usual.source})"
    unit = f"{code(card_unit(name, need)) or 'a number'}{reference}"
    return code(name), unit, value, "yes" if need.required else "", meaning_in_card(need)


assert {*SAID} == {*HEADS, *SECTIONS}, "a section of cards is not said here"
