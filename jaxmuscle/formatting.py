"""Numbers, units and names as people write them: no more digits than are known, plain words for code."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from jaxmuscle.parameter_names import CONSTANT, EFFECTS

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SYMBOLS = {"degC": "°C", "degF": "°F", "deg": "°", "um": "µm", "us": "µs"}
"""Units whose name in a card is not how they are printed."""

LADDERS: dict[str, tuple[tuple[float, str], ...]] = {
    "m": ((1e-6, "µm"), (1e-3, "mm"), (1.0, "m")),
    "m^2": ((1e-6, "mm²"), (1e-2, "m²")),
    "m^3": ((1e-9, "mm³"), (1e-6, "ml"), (1e-3, "l"), (1.0, "m³")),
    "m^3/s": ((1e-6 / 60, "ml/min"), (1e-3 / 60, "l/min")),
    "m/s": ((1e-3, "mm/s"), (1.0, "m/s")),
    "s": ((1e-6, "µs"), (1e-3, "ms"), (1.0, "s")),
    "Pa": ((1.0, "Pa"), (1e3, "kPa"), (1e5, "bar")),
    "Pa/s": ((1.0, "Pa/s"), (1e3, "kPa/s"), (1e5, "bar/s")),
    "kg": ((1e-3, "g"), (1.0, "kg")),
    "kg/s": ((1e-6, "mg/s"), (1e-3, "g/s"), (1.0, "kg/s")),
    "A": ((1e-3, "mA"), (1.0, "A")),
    "V": ((1e-3, "mV"), (1.0, "V")),
    "rad": ((math.radians(1.0), "°"),),
    "rad/s": ((math.radians(1.0), "°/s"), (1.0, "rad/s")),
    "rad/s^2": ((math.radians(1.0), "°/s²"),),
    "rad/Pa": ((math.radians(1.0) / 1e5, "°/bar"),),
    "1/Pa": ((1e-5, "1/bar"),),
    "m/N": ((1e-6, "µm/N"), (1e-3, "mm/N"), (1.0, "m/N")),
    "N/m": ((1.0, "N/m"), (1e3, "N/mm")),
}
"""SI unit → (size in SI, name) of the units in which it is printed, smallest first."""
THRESHOLDS = {
    "mm²": 1e-12,
    "m²": 1e-2,
    "ml": 1e-7,
    "m/s": 0.1,
    "mV": 1e-6,
    "V": 0.1,
    "mm/N": 1e-4,
    "rad/s": 100.0,
}
"""Magnitude (SI) from which a unit is used, where that is not its own size.

What turns by more than 100 rad/s is no joint but a bandwidth, which nobody gives in degrees.
"""


def pretty(unit: str) -> str:
    """A unit as printed: ``mm^2`` → mm², ``deg`` → °, ``N s/m`` → N·s/m."""
    if unit in SYMBOLS:
        return SYMBOLS[unit]
    words = [SYMBOLS.get(word, word) for word in unit.replace("*", " ").split()]
    text = "·".join(words)
    for power in "23456":
        text = text.replace(f"^{power}", power.translate(SUPERSCRIPTS))
    return text.replace("^-", "^⁻").replace("^", "")


def printed_unit(unit: str, magnitude: float) -> tuple[float, str]:
    """(size in SI, name) of the unit in which a quantity of about `magnitude` (SI) is printed."""
    ladder = LADDERS.get(unit)
    if ladder is None:
        return 1.0, pretty(unit)
    fitting = [rung for rung in ladder if abs(magnitude) >= THRESHOLDS.get(rung[1], rung[0])]
    return fitting[-1] if fitting else ladder[0]


def join(number: str, unit: str) -> str:
    """A number and its unit: a space between them, but before a lone degree sign."""
    return number if not unit else f"{number}{unit}" if unit == "°" else f"{number} {unit}"


def rounded(value: float, digits: int = 2) -> str:
    """`value` with `digits` significant digits, integers in full; powers of ten when far from 1."""
    if not math.isfinite(value):
        return "not finite"
    if value == 0:
        return "0"
    exponent = _exponent(float(f"{value:.{digits - 1}e}"))
    if not -4 <= exponent < 6:
        return f"{value / 10.0**exponent:.{digits - 1}f}·10{str(exponent).translate(SUPERSCRIPTS)}"
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def uncertain(value: float, std: float) -> str:
    """A value with its standard deviation, both to the last digit that is known: ``16.2 ± 0.4``.

    The deviation keeps one digit, two when it begins with a 1; without a deviation the value has four.
    """
    if not (math.isfinite(value) and math.isfinite(std) and std > 0):
        return rounded(value, 4)
    place = _last_place(std)
    exponent = _exponent(max(abs(value), std))
    if not -4 <= exponent < 6:
        power = 10.0**exponent
        return f"({uncertain(value / power, std / power)})·10{str(exponent).translate(SUPERSCRIPTS)}"
    decimals = max(-place, 0)
    step = 10.0 ** max(place, 0)
    number, deviation = (f"{round(x / step) * step if place > 0 else x:.{decimals}f}" for x in (value, std))
    return f"{number} ± {deviation}"


def quantity(value: float, unit: str, digits: int = 2) -> str:
    """A value in SI `unit`, printed in a unit of the right size."""
    size, name = printed_unit(unit, value)
    return join(rounded(value / size, digits), name)


def declared(value: float, unit: str) -> str:
    """A value in SI `unit` that somebody gave, no estimate: six digits, without zeros at its end."""
    size, name = printed_unit(unit, value)
    number, power, exponent = rounded(value / size, 6).partition("·")
    shown = number.rstrip("0").rstrip(".") if "." in number else number
    return join(f"{shown}{power}{exponent}", name)


def estimate(value: float, std: float, unit: str) -> str:
    """A value and its standard deviation in SI `unit`, printed in a unit of the right size."""
    known = math.isfinite(std) and std > 0
    size, name = printed_unit(unit, max(abs(value), std) if known else value)
    number = uncertain(value / size, std / size)
    return join(f"({number})" if name == "°" and known else number, name)


def probability(p: float) -> str:
    """A p-value as a comparison: ``p = 0.03``, ``p < 10⁻⁹``."""
    if not math.isfinite(p):
        return "p unknown"
    if p >= 0.001:
        return f"p = {p:.2g}"
    exponent = -300 if p < 1e-300 else math.floor(math.log10(p)) + 1
    return f"p < 10{str(exponent).translate(SUPERSCRIPTS)}"


def percent(share: float) -> str:
    """A share as a percentage that never rounds up to all of it: 99.96 % stays below 100 %."""
    digits = 0 if not 0.99 < share < 1 else 1 if share <= 0.999 else 2
    shown = min(100 * share, 99.99) if digits else 100 * share
    return f"{shown:.{digits}f}\N{NO-BREAK SPACE}%"


def aligned(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as plain text: every column as wide as its longest entry, two spaces between them."""
    lines = [heads, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ([cell.ljust(width) for cell, width in zip(line, widths, strict=True)] for line in lines)
    return "\n".join("  ".join(line).rstrip() for line in padded)


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def _last_place(std: float) -> int:
    """Power of ten of the last digit of a deviation that is kept."""
    # 0.12 keeps both digits, 0.38 becomes 0.4, and 0.096 becomes 0.10.
    begins_with_one = f"{std:.1e}"[0] == "1"
    nearest = _exponent(float(f"{std:.1e}" if begins_with_one else f"{std:.0e}"))
    return nearest - 1 if begins_with_one or f"{std:.0e}"[0] == "1" else nearest


FORMULA = re.compile(r":?\s*:math:`[^`]*`.*")


def words(name: str) -> str:
    """``load_friction`` → load friction; ``constant:mass`` → the card's mass."""
    return name.replace(CONSTANT, "the card's ").replace("_", " ")


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
