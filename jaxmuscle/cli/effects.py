"""The command `effects`."""

from __future__ import annotations

from rich.table import Table

from jaxmuscle.cli.shown import output


def effects() -> None:
    """List the effects that a diagnosis tries: name, signal, rigs that offer it, meaning, source."""
    import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
    from jaxmuscle.actuators import RIGS
    from jaxmuscle.effects import CATALOGUE
    from jaxmuscle.report.words import meaning

    table = Table("name", "signal", "rigs", "meaning", "source", box=None, pad_edge=False)
    table.columns[0].no_wrap = table.columns[1].no_wrap = True
    for effect in CATALOGUE:
        rigs = ", ".join(name for name, rig in RIGS.items() if effect.reads <= rig.available)
        table.add_row(effect.name, effect.slot.name, rigs, meaning(effect.__doc__), effect.source)
    output().print(table)
