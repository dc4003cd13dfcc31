"""The files and the table that `jaxmuscle fit` leaves behind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from jaxmuscle.estimation import FitResult
from jaxmuscle.estimation.saved import as_json
from jaxmuscle.report.numbers import estimate, join, printed_unit, quantity, rounded
from jaxmuscle.report.write import placed, writable_folder

SIGNIFICANT = 5
"""Digits of the ends of an interval."""


def write_fit(result: FitResult, folder: str | Path) -> list[Path]:
    """Write ``result.json`` and a card with the fitted values for each recording: all of them, or none.

    The first recording's card is ``card.toml``, the others' ``card-NAME.toml``.

    Returns:
        The files written.

    Raises:
        InputError: `folder` is a file, or cannot be written; a value that a card has no place for.
    """
    names = list(result.cards)
    texts = {"result.json": as_json(result)}
    for number, name in enumerate(names):
        texts[f"card-{name}.toml" if number else "card.toml"] = result.to_card(name).to_toml()
    return placed(texts, writable_folder(folder))


def rows(result: FitResult) -> Iterator[tuple[str, str, str, str]]:
    """Name, value with its standard deviation, 95 % interval and prior of every parameter, as printed."""
    for name, fitted in result.parameters.items():
        low, high = fitted.interval()
        value = estimate(fitted.value, fitted.std, fitted.unit)
        if fitted.at_bound:
            value += f" (at its {fitted.at_bound} bound)"
        size, unit = printed_unit(fitted.unit, fitted.value)
        known = fitted.std > 0 and math.isfinite(low) and math.isfinite(high)
        ends = f"{rounded(low / size, SIGNIFICANT)} … {rounded(high / size, SIGNIFICANT)}" if known else ""
        prior = "" if fitted.prior is None else estimate(*fitted.prior, fitted.unit)
        yield name, value, join(ends, unit) if ends else "-", prior


def residual_rows(result: FitResult) -> Iterator[tuple[str, str, str, str]]:
    """Recording, column, residual and noise of its sensor, as printed."""
    for recording, columns in result.noise.items():
        for column, noise in columns.items():
            yield recording, column, quantity(noise.residual, noise.unit), quantity(noise.assumed, noise.unit)
