"""The sample as a table and as a recording, for tests that write it in other formats."""

import numpy as np
import pandas as pd

from jaxmuscle.recordings import Card, read
from jaxmuscle.samples import sample

FRAME = pd.read_csv(sample("lift"))
CARD = Card.read(sample("lift").with_suffix(".toml"))
WHOLE = read(sample("lift"))


def assert_whole(recording) -> None:
    assert recording.name == "lift"
    np.testing.assert_array_equal(recording.time, WHOLE.time)
    for name, values in WHOLE.columns.items():
        np.testing.assert_array_equal(recording.columns[name], values)


def card(columns: dict[str, str]) -> Card:
    """The card of the sample with other columns."""
    text = CARD.to_toml()
    for old, new in zip(FRAME.columns, columns.values(), strict=True):
        text = text.replace(f'"{old}"', f'"{new}"')
    return Card.from_toml(text)
