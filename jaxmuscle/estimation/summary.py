"""A fit as text: values with their standard deviations, residuals beside the noise, what has to be known."""

from __future__ import annotations

import math
from collections.abc import Iterator

from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.notes import notes
from jaxmuscle.formatting import aligned, estimate, join, printed_unit, quantity, rounded

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
