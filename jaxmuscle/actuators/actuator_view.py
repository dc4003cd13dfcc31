"""What a notebook shows of a machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import equinox as eqx

from jaxmuscle.actuators.variables import Link
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.formatting import meaning, words
from jaxmuscle.notebook_html import Table, View, parameter_rows
from jaxmuscle.parameter_names import EFFECTS


def actuator_view(
    actuator: eqx.Module,
    rig: str,
    commands: Sequence[str],
    links: Sequence[Link],
    effects: Mapping[str, AbstractEffect],
) -> View:
    """The machine's chain, its parameters in units of the right size, and its effects with theirs."""
    named = parameter_rows(actuator)
    own = [row for path, row in named.items() if not path.startswith(EFFECTS)]
    added = [row for path, row in named.items() if path.startswith(EFFECTS)]
    facts = [f"command: {', '.join(map(words, commands))}"] if commands else ["driven by the bench"]
    facts += [f"predicts {', '.join(words(link.output) for link in links)}"]
    heads = ("", "value", "meaning")
    return View(
        "actuator",
        rig,
        facts,
        lead=[meaning(type(actuator).__doc__)] if type(actuator).__doc__ else [],
        tables=[
            Table("parameters", heads, own),
            Table("effects", ("", "acts on", "meaning"), [_effect(*each) for each in effects.items()]),
            Table("parameters of the effects", heads, added),
        ],
    )


def _effect(name: str, effect: AbstractEffect) -> tuple[str, str, str]:
    return words(name), words(effect.slot.name), meaning(type(effect).__doc__)
