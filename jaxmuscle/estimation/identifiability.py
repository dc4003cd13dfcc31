"""What the data do not determine, in words: parameters without influence, and combinations."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

UNKNOWN = 1.0
"""Standard deviation of a logarithm, by the data alone, from which a combination counts as undetermined."""
NO_INFLUENCE = 1e-6
"""Change of all residuals together, in units of the noise, by a change of one scale, that is none."""
SMALL = 0.08
"""Part of the largest entry of a direction below which an entry is left out."""
LARGEST_DENOMINATOR = 3
NEARLY = 0.06
"""Deviation of an exponent from a simple fraction up to which it is written as one."""


@dataclasses.dataclass(frozen=True)
class Undetermined:
    """A direction in which the parameters can move without a trace in the data.

    Attributes:
        exponents: parameter → how it moves along the direction, the largest 1: the logarithm of parameters of
            the machine that are away from zero, others in units of their scale.
        std: standard deviation along the direction by the data alone, in these units.
        words: a sentence.
    """

    exponents: dict[str, float]
    std: float
    words: str


def without_influence(slopes: Float[NDArray, "k n"], names: Sequence[str]) -> tuple[str, ...]:
    """Parameters that change no prediction; slopes by coordinates in which 1 is a large change."""
    sizes = np.linalg.norm(slopes, axis=1)
    return tuple(name for name, size in zip(names, sizes, strict=True) if size < NO_INFLUENCE)


def undetermined(
    information: Float[NDArray, "k k"],
    prior: Float[NDArray, " k"],
    names: Sequence[str],
    logarithmic: NDArray[np.bool_],
) -> tuple[Undetermined, ...]:
    """The directions of which the data know less than a factor e, or less than the priors, each in words.

    From the near-null singular vectors of the sensitivities in log parameters, brought to the form with the
    fewest entries (reduced echelon form).

    Args:
        information: JᵀJ of the data alone, by the logarithm of some parameters and θ/scale of others.
        prior: 1/std² of the priors in the same coordinates.
        names: parameters; those without any influence are left out by the caller.
        logarithmic: which those are.
    """
    if not len(names):
        return ()
    values, vectors = np.linalg.eigh(information)
    known = np.maximum(1 / UNKNOWN**2, np.einsum("kj,k,kj->j", vectors, prior, vectors))
    null = vectors[:, values < known].T
    found = []
    for direction in _echelon(null):
        direction = np.where(np.abs(direction) < SMALL * np.abs(direction).max(), 0.0, direction)
        direction = direction / direction[np.argmax(np.abs(direction))]
        precision = float(direction @ information @ direction)
        std = precision**-0.5 if precision > 0 else np.inf
        exponents = {n: float(x) for n, x in zip(names, direction, strict=True) if x != 0}
        logs = {n: bool(log) for n, log in zip(names, logarithmic, strict=True)}
        found.append(Undetermined(exponents, std, in_words(exponents, logs, std)))
    return tuple(found)


def in_words(exponents: dict[str, float], logarithmic: dict[str, bool], std: float = np.inf) -> str:
    """What a direction means: the parameter, or the combination that alone is determined.

    Args:
        std: along the direction by the data alone; what they do determine, if not as well as the priors do,
            is not said to be undetermined.
    """
    names = list(exponents)
    if std < UNKNOWN:
        return _less_than_priors(exponents, logarithmic, std)
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


def _less_than_priors(exponents: dict[str, float], logarithmic: dict[str, bool], std: float) -> str:
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


def _echelon(rows: Float[NDArray, "r k"]) -> Float[NDArray, "r k"]:
    """Reduced row echelon form, with the largest pivot each time."""
    rows = rows.copy()
    done: list[int] = []
    for i in range(len(rows)):
        open_columns = np.abs(rows[i:]).copy()
        open_columns[:, done] = 0.0
        row, column = np.unravel_index(np.argmax(open_columns), open_columns.shape)
        rows[[i, i + row]] = rows[[i + row, i]]
        rows[i] /= rows[i, column]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, column], rows[i])
        done.append(int(column))
    return rows
