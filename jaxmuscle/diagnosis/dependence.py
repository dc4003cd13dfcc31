"""Dependence of the model discrepancy on measured variables: a nonparametric term, and what the final model
leaves unexplained.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.diagnosis.diagnosis_data import CONSTANT, Error, Pattern, Unexplained
from jaxmuscle.diagnosis.discrepancy import MissingRate, Slopes
from jaxmuscle.diagnosis.excitation import columns_moving_within_a_segment, moving_columns
from jaxmuscle.diagnosis.residual_pattern import Residual, residual_pattern
from jaxmuscle.estimation.case import Case

Series = NDArray[np.float64]

KNOTS = 9
WORTHWHILE = 0.05
"""Further share that a variable must explain to be named."""
MOST = 3
LEAST_CONSTANT = 0.5
"""Share of what is missing that a constant explains at least, to be named."""


@dataclasses.dataclass(frozen=True)
class Dependence:
    """What explains a missing rate on unseen windows, beside the free parameters of the model.

    Attributes:
        variables, share: share that smooth functions of these explain of what a constant leaves.
        constant: share that a constant explains of what the free parameters alone leave.
    """

    variables: tuple[str, ...]
    share: float
    constant: float


def variables(case: Case) -> dict[str, Series]:
    """The measured variables that move, by name: columns, and rates of those that have a rate state.

    The commands, where no state of the rig is measured. A rate moves where its column moves within a segment.
    """
    actuator, measured = case.actuator, case.observed.track.measured
    moving, within = moving_columns(case), columns_moving_within_a_segment(case)
    if not actuator.measured:
        return {name: case.filled.columns[name] for name in actuator.commands if name in moving}
    named: dict[str, Series] = {}
    for state, columns in {
        **actuator.measured,
        **{d: actuator.measured[b] for d, b in actuator.derivatives.items()},
    }.items():
        table = np.asarray(measured[state]).reshape(case.observed.samples, -1)
        for i, column in enumerate(columns):
            if column in (moving if state in actuator.measured else within):
                named[column if state in actuator.measured else state] = table[:, i]
    return named


def dependence(missing: MissingRate, named: Mapping[str, Series], case: Case, slopes: Slopes) -> Dependence:
    """Find the variables on which a missing rate depends, one by one, judged on windows left out.

    Each has to explain more than those before it, the first one more than a constant.

    Every second training window is fitted, the others judge, and the other way round. Weights are the
    precision of the missing rate at each sample. The free parameters of the model are fitted along: those of
    a model that lacks something are bent to make up for it. A joint without its gravity was given more
    friction than it has, so that what it lacked seemed to depend on the velocity.

    Args:
        slopes: of the missing rate by the free parameters (:func:`~discrepancy.rate_slopes`).
    """
    chosen: tuple[str, ...] = ()
    bent = max(explained(missing, named, None, case, slopes), 0.0)
    best = level = max(explained(missing, named, (), case, slopes), bent)
    while len(chosen) < MOST:
        trials: dict[tuple[str, ...], float] = {
            (*chosen, name): explained(missing, named, (*chosen, name), case, slopes)
            for name in named
            if name not in chosen
        }
        if not trials:
            break
        candidate = max(trials, key=trials.__getitem__)
        if trials[candidate] < best + WORTHWHILE:
            break
        chosen, best = candidate, trials[candidate]
    constant = (level - bent) / (1 - bent) if bent < 1 else 0.0
    return Dependence(chosen, (best - level) / (1 - level) if chosen else 0.0, constant)


def _training_rows(case: Case) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the training windows whose readings all count, and the fold of each."""
    windows, usable = case.windows, np.logical_and.reduce([*case.usable.values()])
    rows, folds = [], []
    for number in np.flatnonzero(~windows.held_out):
        inside = windows.rows[number] + np.flatnonzero(windows.mask[number])
        inside = inside[usable[inside]]
        rows.append(inside)
        folds.append(np.full(len(inside), number % 2))
    return np.concatenate(rows), np.concatenate(folds)


def explained(
    missing: MissingRate,
    named: Mapping[str, Series],
    names: tuple[str, ...] | None,
    case: Case,
    slopes: Slopes | None = None,
) -> float:
    """Share of a missing rate that smooth functions of `names` explain on windows they were not fitted to.

    Args:
        names: without any, a constant; `None`: not even that.
        slopes: of the missing rate by what else is free.
    """
    rows, fold = _training_rows(case)
    basis = _smooth(named, names, rows)
    before = after = 0.0
    for column, values in missing.values.items():
        weight = _precision(missing, column, rows)
        terms = basis if slopes is None else np.hstack([basis, _of_one_size(slopes[column][rows])])
        target, scaled = values[rows] * weight, terms * weight[:, None]
        for judged in (0, 1):
            fitted, unseen = fold != judged, fold == judged
            coefficients = _ridge_regression(scaled[fitted], target[fitted])
            before += float((target[unseen] ** 2).sum())
            after += float(((target[unseen] - scaled[unseen] @ coefficients) ** 2).sum())
    return 1 - after / before if before > 0 else 0.0


def missing_constant(missing: MissingRate, case: Case, slopes: Slopes) -> float:
    """The constant that explains a missing rate best beside the free parameters; of the column where it is
    largest against its spread.
    """
    rows, _ = _training_rows(case)
    found = []
    for column, values in missing.values.items():
        weight = _precision(missing, column, rows)
        terms = np.hstack([np.ones((len(rows), 1)), _of_one_size(slopes[column][rows])])
        found.append(_ridge_regression(terms * weight[:, None], values[rows] * weight)[0])
    sizes = [np.median(missing.spread[column][rows]) for column in missing.values]
    return float(max(zip(found, sizes, strict=True), key=lambda pair: abs(pair[0]) / pair[1])[0])


def _precision(missing: MissingRate, column: str, rows: NDArray[np.int64]) -> Series:
    spread = missing.spread[column][rows]
    return 1 / np.maximum(spread, np.quantile(spread, 0.05) + 1e-300)


def _of_one_size(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slopes by what acts on a column at all, each with 1 as its largest value, as hat functions have."""
    size = np.abs(slopes).max(axis=0)
    acts = np.isfinite(size) & (size > 0)
    return slopes[:, acts] / size[acts]


def _ridge_regression(terms: NDArray[np.float64], target: Series) -> NDArray[np.floating]:
    if not terms.shape[1]:
        return np.zeros(0)
    ridge = np.sqrt(1e-6) * np.linalg.norm(terms, axis=0).max() * np.eye(terms.shape[1])
    padded = np.concatenate([target, ridge[0] * 0])
    return np.linalg.lstsq(np.vstack([terms, ridge]), padded, rcond=None)[0]


def _smooth(
    named: Mapping[str, Series], names: tuple[str, ...] | None, rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    if names is None:
        return np.zeros((len(rows), 0))
    return _basis([named[name][rows] for name in names]) if names else np.ones((len(rows), 1))


def _basis(series: list[Series]) -> NDArray[np.float64]:
    """Hat functions of every variable, its sign, and the products of low degree between variables.

    Nothing grows outside the range of the data: a polynomial would, on windows that reach a little further.
    """
    parts = [np.ones((len(series[0]), 1))]
    low = []
    for values in series:
        knots = np.unique(np.quantile(values, np.linspace(0, 1, KNOTS)))
        hats = np.stack([np.interp(values, knots, unit) for unit in np.eye(len(knots))[1:]], axis=1)
        sign = np.tanh(values / (0.02 * np.abs(values).max() + 1e-300))[:, None]
        centred = (values - values.mean())[:, None] / (np.ptp(values) + 1e-300)
        parts += [hats, sign]
        low.append(np.hstack([centred, sign]))
    for i, first in enumerate(low):
        for second in low[i + 1 :]:
            parts.append((first[:, :, None] * second[:, None, :]).reshape(len(first), -1))
    return np.hstack(parts)


SURPRISE = 3.0
"""Ratio of errors on unseen and on training data above which the training data did not tell all."""
UNEXPLAINED = 3.0
"""Root mean square weighted residual of a link (1 = noise) above which something is left unexplained."""


def unexplained(
    case: Case,
    missing: Sequence[MissingRate],
    slopes: Callable[[], Sequence[Slopes]],
    squares: Mapping[str, float],
    after: Mapping[str, Mapping[str, Error]],
    residual_of: Callable[[str], Residual],
) -> tuple[Unexplained, ...]:
    """Links whose residual the final model leaves large, on the training data or only on unseen data.

    Args:
        slopes: gives those of the missing rates by the free parameters, link by link.
        residual_of: gives what the model leaves of an output on the training windows.
    """
    left = []
    for i, rate in enumerate(missing):
        rms = float(np.sqrt(squares[rate.link.output]))
        for column in case.actuator.outputs[rate.link.output]:
            seen, unseen = (after[part][column].in_noise for part in ("training", "held_out"))
            if unseen > SURPRISE * max(seen, 1.0):
                rms = max(rms, unseen)
        if rms > UNEXPLAINED:
            named = variables(case)
            found = dependence(rate, named, case, slopes()[i])
            pattern = residual_pattern(residual_of(rate.link.output), named, case, found.share)
            if pattern is None and found.constant > LEAST_CONSTANT:
                level = missing_constant(rate, case, slopes()[i])
                pattern = Pattern(CONSTANT, "time", level, rate.unit, found.constant)
            left.append(Unexplained(rate.link.signal, found.share, found.variables, rms, pattern))
    return tuple(left)
