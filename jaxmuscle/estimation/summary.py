"""Summary of a fit as text: values with standard deviations, residuals beside the noise, warnings."""

from __future__ import annotations

import math
from collections.abc import Iterator

from jaxmuscle.estimation.fit_data import FitData
from jaxmuscle.formatting import aligned, estimate, join, printed_unit, quantity, rounded
from jaxmuscle.notebook_html import Sparkline, Table, View

ENDS = {
    "converged": "The fit converged",
    "stalled": "The fit stalled: no step lowers the cost any more, which is too rugged there; standard "
    "deviations, which go by slopes, may be too small",
    "steps": "The fit ran out of steps; this is the best so far",
    "budget": "The fit ran out of time; this is the best so far",
}
MUCH = 2.0
"""Ratio of residual to noise from which the model is said to lack something."""
CORRELATED = 0.98
BETTER = -0.5
"""Deviance of a point of a profile from which it is another, better fit."""


def notes(result: FitData) -> list[str]:
    """How it ended, starts that failed, what is not determined, what speaks against the model."""
    ran = sum(start.code != "failed" for start in result.starts)
    same = sum(start.reached for start in result.starts)
    found = [f"{ENDS[result.code]} ({result.iterations} iterations)."]
    if len(result.starts) > 1:
        found.append(f"{same} of {len(result.starts)} starts reached the best minimum.")
    if ran < len(result.starts):
        reasons = "; ".join(f"{count} × {reason}" for reason, count in result.failed.items())
        found.append(f"{len(result.starts) - ran} starts failed and were set aside: {reasons}.")
    found += _idle(result)
    found += [
        f"{name} ended at its {fitted.at_bound} bound."
        for name, fitted in result.parameters.items()
        if fitted.at_bound
    ]
    found += [f"{_capital(each.words, result)}." for each in result.undetermined]
    found += (
        _rough(result) + _profiles(result) + _correlated(result) + _against_priors(result) + _misfit(result)
    )
    return found


def _capital(words: str, result: FitData) -> str:
    """A sentence from words; the name of a parameter with which they begin stays as it is."""
    return words if words.startswith(tuple(result.parameters)) else f"{words[0].upper()}{words[1:]}"


def _rough(result: FitData) -> list[str]:
    return [
        f"{each.recording} from {each.begin:g} to {each.end:g} s tells nothing of {each.parameter}: "
        f"moved by one standard deviation it should change the residuals there by {each.promised:.3g} "
        f"(root of the sum of squares, in units of the noise), and changes them by {each.found:.3g}."
        for each in result.rough
    ]


def _profiles(result: FitData) -> list[str]:
    found = []
    for each in result.profiles:
        if each.missing:
            found.append(
                f"The profile of {each.name} lacks {each.missing} of its points, which failed or were not at "
                f"their end when steps or time were up."
            )
        if each.deviance.min() < BETTER:
            where = each.values[each.deviance.argmin()]
            found.append(
                f"The profile of {each.name} finds a better fit than this one at {where:.6g}: begin there "
                f"(starts=)."
            )
    return found


def _against_priors(result: FitData) -> list[str]:
    found = []
    for name, fitted in result.parameters.items():
        if fitted.prior is not None and fitted.conflict:
            prior = estimate(*fitted.prior, fitted.unit)
            found.append(
                f"By the data {name} is {fitted.conflict:.1f} standard deviations away from its prior "
                f"({prior}): the prior, its unit or the model is wrong."
            )
    return found


def _idle(result: FitData) -> list[str]:
    """Without influence on the data: what is not held by a prior either stayed where it was."""
    found = []
    for name in result.idle:
        fitted = result.parameters[name]
        decided = "stayed where it was" if fitted.prior is None else "is what its prior says"
        found.append(f"{name} has no influence on the data; it {decided}.")
    return found


def _correlated(result: FitData) -> list[str]:
    table, names = result.correlations, list(result.correlations.index)
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    told = {name for each in result.undetermined for name in each.exponents}
    return [
        f"{a} and {b} are hardly told apart (correlation {float(table.at[a, b]):.3f})."
        for a, b in pairs
        if abs(float(table.at[a, b])) > CORRELATED and not {a, b} <= told
    ]


def _misfit(result: FitData) -> list[str]:
    found = []
    for recording, columns in result.noise.items():
        for column, noise in columns.items():
            if noise.ratio > MUCH:
                found.append(
                    f"The residual of {column} in {recording} is {noise.ratio:.1f} times what its sensor's "
                    f"noise accounts for: the model may lack something (jaxmuscle diagnose). Until it has "
                    f"it, noise='estimated' (--estimate-noise) gives priors their due weight."
                )
    coloured = [t for t in result.tests if t.against == "itself" and not t.passed]
    if coloured:
        where = ", ".join(f"{t.column} in {t.recording}" for t in coloured)
        found.append(f"Residuals are not white ({where}); the standard deviations allow for it.")
    related = [t for t in result.tests if t.against != "itself" and not t.passed]
    if related:
        where = ", ".join(f"{t.column} on {t.against} in {t.recording}" for t in related)
        found.append(f"Residuals depend on the input ({where}): the model lacks something there.")
    return found


SIGNIFICANT = 5
"""Digits of the ends of an interval."""
VALUES = ("parameter", "value", "95 % interval", "prior")
RESIDUALS = ("recording", "column", "residual", "sensor noise")


def rows(result: FitData) -> Iterator[tuple[str, str, str, str]]:
    """Name, value with its standard deviation, 95 % interval and prior of every parameter, as printed."""
    for name, fitted in result.parameters.items():
        low, high = fitted.interval()
        value = estimate(fitted.value, fitted.std, fitted.unit)
        if fitted.at_bound:
            value += f" (at its {fitted.at_bound} bound)"
        size, unit = printed_unit(fitted.unit, fitted.value)
        known = low < high and math.isfinite(low) and math.isfinite(high)
        ends = f"{rounded(low / size, SIGNIFICANT)} … {rounded(high / size, SIGNIFICANT)}" if known else ""
        prior = "" if fitted.prior is None else estimate(*fitted.prior, fitted.unit)
        yield name, value, join(ends, unit) if ends else "-", prior


def residual_rows(result: FitData) -> Iterator[tuple[str, str, str, str]]:
    """Recording, column, residual and noise of its sensor, as printed."""
    for recording, columns in result.noise.items():
        for column, noise in columns.items():
            yield recording, column, quantity(noise.residual, noise.unit), quantity(noise.assumed, noise.unit)


def summary(result: FitData) -> str:
    """All of it, as `print(fit)` shows it."""
    tables = aligned(VALUES, rows(result)), aligned(RESIDUALS, residual_rows(result))
    return "\n\n".join([*tables, "\n".join(notes(result))])


def view(result: FitData) -> View:
    """All of it as a notebook shows it: measured and fitted columns over each other beside the residuals."""
    residuals = [
        (*row, _curves(result, row[0], row[1]), f"{result.noise[row[0]][row[1]].ratio:.2g}")
        for row in residual_rows(result)
    ]
    recordings = ", ".join(result.cards)
    return View(
        "fit",
        recordings,
        (f"rig {result.actuator.rig}", f"{result.samples} residuals", f"{result.seconds:.1f} s"),
        badge=result.code,
        mood="good" if result.converged else "doubt",
        tables=[
            Table("parameters", VALUES, list(rows(result))),
            Table("residuals", (*RESIDUALS, "measured, fitted", "residual over expected"), residuals),
        ],
        notes=notes(result),
    )


def _curves(result: FitData, recording: str, column: str) -> Sparkline:
    table = result.predictions[recording]
    return Sparkline(table[column].to_numpy(dtype=float), table[f"{column} fitted"].to_numpy(dtype=float))
