"""Directions in which parameters can move, as sentences."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

LARGEST_DENOMINATOR = 3
NEARLY = 0.06
"""Deviation of an exponent from a simple fraction up to which it is written as one."""


def in_words(exponents: dict[str, float], logarithmic: dict[str, bool]) -> str:
    """What an undetermined direction means: the parameter, or the combination that alone is determined."""
    names = list(exponents)
    if len(names) == 1:
        return f"{names[0]} is not determined by the data"
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    if not all(logarithmic[name] for name in names):
        moves = _moves(exponents, logarithmic, 0.1)
        return f"{listed} are not determined one by one: the data allow to shift {moves}"
    if len(names) == 2:
        a, b = (exponents[name] for name in names)
        return f"only {_product({names[0]: 1.0, names[1]: -a / b})} is determined, not {listed} one by one"
    moves = _scaled(exponents)
    return f"{listed} are not determined one by one: the data allow to scale {moves} together"


def less_than_priors(exponents: dict[str, float], logarithmic: dict[str, bool], std: float) -> str:
    """What priors tell better than the data.

    Args:
        std: along the direction by the data alone, all other parameters following.
    """
    names = list(exponents)
    if len(names) == 1:
        size = f"{100 * std:.2g} %" if logarithmic[names[0]] else f"{std:.2g} of its scale"
        return f"the prior tells more of {names[0]} than the data, whose own standard deviation is {size}"
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    if all(logarithmic[name] for name in names):
        change = f"scaling {_scaled(exponents)} together by {100 * std:.2g} %"
    else:
        change = f"shifting {_moves(exponents, logarithmic, std)}"
    return f"the priors tell {listed} apart better than the data, to which {change} is one standard deviation"


def _moves(exponents: dict[str, float], logarithmic: dict[str, bool], times: float) -> str:
    """How far each goes, `times` along the direction."""
    return ", ".join(
        f"{name} by {100 * times * x:+.2g} %"
        if logarithmic[name]
        else f"{name} by {times * x:+.2g} of its scale"
        for name, x in exponents.items()
    )


def _scaled(exponents: dict[str, float]) -> str:
    """What is scaled up, and what down."""
    return _product(exponents).replace(" / ", " and inversely ")


def _product(exponents: dict[str, float]) -> str:
    """``area / volume``, ``mass · length^2``; an exponent near a simple fraction is written as one."""
    sign = np.sign(next(iter(exponents.values())))
    parts: tuple[list[str], list[str]] = ([], [])
    for name, exponent in exponents.items():
        power = _rounded(abs(exponent))
        text = name if power == "1" else f"{name}^{power}"
        parts[0 if sign * exponent > 0 else 1].append(text)
    above, below = (" · ".join(side) for side in parts)
    if below and " · " in below:
        below = f"({below})"
    return f"{above} / {below}" if below else above


def _rounded(exponent: float) -> str:
    simple = Fraction(exponent).limit_denominator(LARGEST_DENOMINATOR)
    if simple and abs(float(simple) - exponent) <= NEARLY * exponent:
        return str(simple) if simple.denominator == 1 else f"({simple})"
    return f"{exponent:.2g}"
