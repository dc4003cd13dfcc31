"""Names of the code in plain words."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxmuscle.parameter_names import EFFECTS

FORMULA = re.compile(r":?\s*:math:`[^`]*`.*")


def words(name: str) -> str:
    """``load_friction`` → load friction."""
    return name.replace("_", " ")


def parameter_words(name: str) -> str:
    """``effects.load_friction.force`` → load friction: force."""
    return words(name.removeprefix(EFFECTS).replace(".", ": "))


def capital(text: str) -> str:
    """`text` with a capital at its beginning, the rest as it is."""
    return text[:1].upper() + text[1:]


def meaning(docstring: str | None) -> str:
    """The first line of a docstring without its formula and markup."""
    line = (docstring or "").strip().partition("\n")[0]
    return FORMULA.sub(".", line).replace("`", "")


def listed(items: Sequence[str], most: int = 4, last: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``; what is beyond `most` is only counted."""
    shown = list(items)
    if len(shown) > most:
        shown = [*shown[: most - 1], f"{len(items) - most + 1} others"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} {last} {shown[-1]}"
