"""Identifiability: parameters and combinations that the data do not determine, in words."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.estimation.free_parameters import Unknowns
from jaxmuscle.parameter_names import of_machine

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


Matrix = Float[np.ndarray, "k k"]

UNKNOWN = 1.0
"""Standard deviation of a logarithm, by the data alone, from which a combination counts as undetermined."""
NO_INFLUENCE = 1e-6
"""Change of all residuals together, in units of the noise, by a change of one scale, that is none."""
SMALL = 0.08
"""Part of the largest entry of a direction below which an entry is left out."""


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


def without_influence(slopes: Float[np.ndarray, "k n"], names: Sequence[str]) -> tuple[str, ...]:
    """Parameters that change no prediction; slopes by coordinates in which 1 is a large change."""
    sizes = np.linalg.norm(slopes, axis=1)
    return tuple(name for name, size in zip(names, sizes, strict=True) if size < NO_INFLUENCE)


def undetermined(
    information: Matrix, prior: Float[np.ndarray, " k"], names: Sequence[str], logarithmic: NDArray[np.bool_]
) -> tuple[Undetermined, ...]:
    """The directions of which the data know less than a factor e, or less than the priors, each in words.

    The first are the near-null singular vectors of the sensitivities in log parameters; of the second there
    are at most as many as priors. Both are brought to the form with the fewest entries (reduced echelon
    form).

    Args:
        information: JᵀJ of the data alone, by the logarithm of some parameters and θ/scale of others.
        prior: 1/std² of the priors in the same coordinates.
        names: parameters; those without any influence are left out by the caller.
        logarithmic: which those are.
    """
    if not len(names):
        return ()
    logs = {n: bool(log) for n, log in zip(names, logarithmic, strict=True)}
    space = _Space(information, prior)
    found = []
    for direction in _echelon(space.unknown.T):
        size = np.abs(direction)
        exponents = _named(direction, size >= SMALL * size.max(), names)
        precision = float(direction @ information @ direction) / float(size.max()) ** 2
        std = precision**-0.5 if precision > 0 else np.inf
        found.append(Undetermined(exponents, std, in_words(exponents, logs)))
    for weights in space.told_by_priors():
        direction, std = space.by_data(weights)
        exponents = _named(direction, weights != 0, names)
        found.append(Undetermined(exponents, std, less_than_priors(exponents, logs, std)))
    return tuple(found)


class _Space:
    """Directions by what data and priors know of them.

    Attributes:
        unknown: columns, directions of which the data know less than a factor e.
    """

    def __init__(self, information: Matrix, prior: Float[np.ndarray, " k"]) -> None:
        """Split the space by the eigenvalues of the data's information."""
        values, vectors = np.linalg.eigh(information)
        loose = values < 1 / UNKNOWN**2
        self.unknown, self._open = vectors[:, loose], np.maximum(values[loose], 0.0)
        self._known = vectors[:, ~loose] / np.sqrt(values[~loose])
        self._prior = prior

    def told_by_priors(self) -> list[Float[np.ndarray, " k"]]:
        r"""Sums c of the parameters, c'u, of which the priors know more than the data.

        They are c = P v with :math:`P v = \lambda M v`, :math:`\lambda > 1`, P the priors' information and M
        the data's: they hold parameters with a prior only. What a prior says goes first into the directions
        that the data leave open; the rest, that of the Schur complement, is compared.
        """
        into = self.unknown.T * self._prior
        taken = np.linalg.pinv(into @ self.unknown + np.diag(self._open), hermitian=True)
        rest = np.diag(self._prior) - into.T @ taken @ into
        ratios, axes = np.linalg.eigh(self._known.T @ rest @ self._known)
        sums = rest @ self._known @ axes[:, ratios > 1]
        # In units of the priors' standard deviations, in which all that they tell has one size.
        deviations = np.where(self._prior > 0, 1 / np.sqrt(np.where(self._prior > 0, self._prior, 1.0)), 0.0)
        found = []
        for row in _echelon((deviations[:, None] * sums).T):
            row = np.where(np.abs(row) < SMALL * np.abs(row).max(), 0.0, row)
            weights = row / np.where(deviations > 0, deviations, 1.0)
            if np.linalg.norm(row) < np.linalg.norm(weights @ self._known):
                found.append(weights)
        return found

    def by_data(self, weights: Float[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " k"], float]:
        """How the parameters move when such a sum does, by the data alone, all others following: the largest
        with a prior by 1; and the standard deviation along it.
        """
        direction = self._known @ (self._known.T @ weights)
        size = float(np.abs(direction[weights != 0]).max())
        return direction / size, size / float(np.linalg.norm(weights @ self._known))


def _named(
    direction: Float[np.ndarray, " k"], kept: NDArray[np.bool_], names: Sequence[str]
) -> dict[str, float]:
    """The entries of a direction that are kept, the largest of them 1."""
    direction = np.where(kept, direction, 0.0)
    direction = direction / direction[np.argmax(np.abs(direction))]
    return {name: float(x) for name, x in zip(names, direction, strict=True) if x != 0}


def _echelon(rows: Float[np.ndarray, "r k"]) -> Float[np.ndarray, "r k"]:
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


def identifiability(
    slopes: NDArray[np.float64], unknowns: Unknowns, u: NDArray[np.float64], ends: NDArray[np.int64]
) -> tuple[tuple[str, ...], tuple[Undetermined, ...]]:
    """Names without influence on any reading, and what else the data do not determine, at a minimum.

    Args:
        slopes: derivatives of the residuals by the coordinates u.
        ends: which of them lie at a bound.
    """
    idle = without_influence(slopes, unknowns.names)
    kept = [i for i, name in enumerate(unknowns.names) if name not in idle and not ends[i]]
    relative, logarithmic = _relative(unknowns, u)
    inner = slopes[kept] * relative[kept, None]
    prior = (unknowns.prior_slopes * relative)[kept] ** 2
    names = [unknowns.names[i] for i in kept]
    return idle, undetermined(inner @ inner.T, prior, names, logarithmic[kept])


def _relative(unknowns: Unknowns, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Slopes of the coordinates by the logarithm of the values, and where they are these.

    What may be zero, but is not near it, such as the force of a friction, is told apart from others by its
    ratio to them as well as what is always positive. An offset or an initial state adds to something.
    """
    values = unknowns.values(u)
    machines = np.array([of_machine(entry.place.path) for entry in unknowns.entries])
    away = machines & ~unknowns.logarithmic & (np.abs(values) >= unknowns.scale)
    return np.where(away, values / unknowns.scale, 1.0), unknowns.logarithmic | away
