"""Reference of effects: equation, source, signal and parameters of every effect, from its class."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable

from docstring_markup import as_markdown
from tables import code, table

import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import ALTERNATIVE_FORMS, CATALOGUE, DECLARABLE, EXTENSION, AbstractEffect
from jaxmuscle.effects.readings import KINDS, USUAL_OFFSETS
from jaxmuscle.formatting import meaning, words
from jaxmuscle.parameters import Declaration

TEMPLATES = {
    "{load}": "N or N m",
    "{motion}": "m or rad",
    "{command}": "the command's unit",
}
"""Units that depend on the rig → how a reader knows them."""
GROUPS = (
    ("The catalogue", CATALOGUE, "What a diagnosis seeks first."),
    (
        "Where the catalogue leaves something",
        EXTENSION,
        "What the last pass of a diagnosis seeks as well, with the errors of the sensors below.",
    ),
    (
        "Only where they are named",
        DECLARABLE,
        "Cards may declare them, and `jm.diagnose(…, catalogue=…)` seeks them where they are named: on "
        "many recordings they imitate others. Of these `presliding` is tried by itself too, where the "
        "catalogue leaves something and the card declares dry friction.",
    ),
    (
        "Alternative forms",
        ALTERNATIVE_FORMS,
        "Other models of an effect of the catalogue: cards may declare them, no diagnosis seeks them.",
    ),
)


def effect_reference() -> str:
    """The page."""
    parts = [
        "# Effects\n",
        "An effect is an addition to one signal of the chain, with a strength at which it vanishes exactly. "
        "This page is generated from the code. Sources in brackets are [those of the package]"
        "(../explanation/sources.md); `jaxmuscle effects` prints the list, and [My effect]"
        "(../how-to/effect.md) adds one.\n",
        "Units that depend on the rig: of a load N or N m, of a motion m or rad.\n",
        "## At a glance\n",
        table(
            ("effect", "signal", "rigs", "meaning"),
            [row for _, effects, _ in GROUPS for row in _overview(effects)],
        ),
    ]
    for title, effects, said in GROUPS:
        parts += [f"## {title}\n", f"{said}\n", *(_effect(effect) for effect in effects)]
    return "\n".join([*parts, _sensors()])


def _overview(effects: Iterable[type[AbstractEffect]]) -> list[tuple[str, str, str, str]]:
    return [(f"[`{e.name}`](#{anchor(e)})", code(e.slot.name), _rigs(e), _first(e)) for e in effects]


def _effect(effect: type[AbstractEffect]) -> str:
    about = as_markdown(inspect.cleandoc(effect.__doc__ or ""))
    facts = (
        f"`[effects.{effect.name}]` in a card, `jm.effects.{effect.__name__}` in Python. Acts on "
        f"`{effect.slot.name}`; its strength is `{effect.strength}`. Rigs: {_rigs(effect)}. "
        f"Source: {effect.source}.\n"
    )
    return "\n".join(
        [
            f"### {words(effect.name).capitalize()}{_of(effect)} {{ #{anchor(effect)} }}\n",
            facts,
            f"{about}\n",
            table(("parameter", "unit (SI)", "when not given", "meaning"), _parameters(effect)),
        ]
    )


def _parameters(effect: type[AbstractEffect]) -> list[tuple[str, str, str, str]]:
    rows = []
    for field in (each for each in dataclasses.fields(effect) if "unit" in each.metadata):
        said = Declaration.of(field, {})
        taken = "" if field.default is dataclasses.MISSING else f"{field.default:g}"
        limits = " (above zero)" if said.positive else " (not negative)" if said.nonnegative else ""
        rows.append((code(field.name), _unit(said.unit), taken, f"{said.meaning}{limits}"))
    return rows


def _unit(unit: str) -> str:
    for template, known in TEMPLATES.items():
        unit = known if unit == template else unit.replace(template, f"({known})")
    return unit or "—"


def _rigs(effect: type[AbstractEffect]) -> str:
    return ", ".join(name for name, rig in RIGS.items() if rig.offers(effect)) or "no rig of the package"


def _first(effect: type[AbstractEffect]) -> str:
    """The first paragraph of a docstring."""
    return as_markdown(inspect.cleandoc(effect.__doc__ or "").split("\n\n")[0])


def _is_form(effect: type[AbstractEffect]) -> bool:
    """Whether it is an effect of another class's name, on other rigs."""
    return any(effect in each.forms for _, effects, _ in GROUPS for each in effects)


def anchor(effect: type[AbstractEffect]) -> str:
    """Where the page tells of it."""
    return f"{effect.name}-{effect.slot.name}" if _is_form(effect) else effect.name


def _of(effect: type[AbstractEffect]) -> str:
    return f" of the {words(effect.slot.name)}" if _is_form(effect) else ""


def _sensors() -> str:
    columns = ", ".join(code(name) for name in USUAL_OFFSETS)
    rows = [(code(f"{kind}_COLUMN"), as_markdown(meaning(e.__doc__)), e.source) for kind, e in KINDS.items()]
    return "\n".join(
        [
            "## Errors of sensors {#sensors}\n",
            f"Of every measured column of every rig, such as {columns}: `[effects.sensor_offset_pressure]`. "
            "A measured input is corrected in every link; predictions and a controller's readings show the "
            "error.\n",
            table(("effect", "meaning", "source"), rows),
            *(f"### {words(k).capitalize()} {{ #{k} }}\n\n{as_markdown(inspect.cleandoc(e.__doc__ or ''))}\n"
              for k, e in KINDS.items()),
        ]
    )  # fmt: skip
