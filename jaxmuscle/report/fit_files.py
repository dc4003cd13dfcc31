"""The files that `jaxmuscle fit` leaves behind."""

from __future__ import annotations

from pathlib import Path

from jaxmuscle.estimation import FitResult
from jaxmuscle.estimation.saved import as_json
from jaxmuscle.report.write import placed, writable_folder


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
