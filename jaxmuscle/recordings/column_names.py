"""Names of columns as laboratories write them: words, unit, number, gauge or absolute."""

from __future__ import annotations

import dataclasses
import re

from jaxmuscle.units import unit_in

BRACKETED = re.compile(r"(?P<name>.*?)[\s_,.:]*[\[(<{](?P<unit>[^\])>}]*)[\])>}]\s*")
SEPARATED = re.compile(r"(?P<name>.*?)(?:\s+in\s+|\s*[,/:]\s*|[\s_.\-]+)(?P<unit>[^\s_,:]+)")
WORD = re.compile(r"[A-Za-zÄÖÜäöüßθφαβω]+")
HUMP = re.compile(r"(?<=[a-zäöü])(?=[A-ZÄÖÜ])")
GAUGE = frozenset({"gauge", "gage", "rel", "relative", "relativ"})
ABSOLUTE = frozenset({"abs", "absolute", "absolut"})


@dataclasses.dataclass(frozen=True)
class ColumnName:
    """What the name of a column says.

    Attributes:
        words: in lower case, without unit and numbers.
        number: the last number in it, `None` if there is none.
        unit: as a card has it, `None` where none is named.
        reference: gauge or absolute, where it says so.
    """

    words: tuple[str, ...]
    number: int | None
    unit: str | None
    reference: str | None


def column_name(name: str, stated_unit: str = "") -> ColumnName:
    """What a name such as ``p1_bar``, ``"pressure 2 [kPa]"`` or ``sensor/p.abs (mbar)`` says.

    Args:
        name: of the column, with its group.
        stated_unit: what the file says beside it; it counts more than what the name says.
    """
    bare, unit = _without_unit(name.rpartition("/")[2])
    told = unit_in(stated_unit) or unit
    numbers = re.findall(r"\d+", bare)
    group = name.rpartition("/")[0]
    words = [w.lower() for part in WORD.findall(f"{bare} {group}") for w in HUMP.split(part)]
    reference = told[1] if told else None
    if reference is None:
        reference = "gauge" if GAUGE & {*words} else "absolute" if ABSOLUTE & {*words} else None
    return ColumnName(
        tuple(words), int(numbers[-1]) if numbers else None, told[0] if told else None, reference
    )


def _without_unit(name: str) -> tuple[str, tuple[str, str | None] | None]:
    """A name and the unit at its end, if there is one."""
    for form in (BRACKETED, SEPARATED):
        found = form.fullmatch(name.strip())
        if found is not None and found["name"] and (unit := unit_in(found["unit"])) is not None:
            return found["name"], unit
    return name, None
