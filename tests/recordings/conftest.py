"""A copy of a sample recording on a desk, to be spoilt."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample


class Desk:
    """A table and its card in a folder of their own."""

    def __init__(self, folder: Path, name: str) -> None:
        self.table = folder / f"{name}.csv"
        self.card = folder / f"{name}.toml"
        shutil.copyfile(sample(name), self.table)
        shutil.copyfile(sample(name).with_suffix(".toml"), self.card)

    def write(self, old: str, new: str) -> None:
        """Replace one piece of the card's text."""
        text = self.card.read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the card"
        self.card.write_text(text.replace(old, new), encoding="utf-8")

    def change(self, alter: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
        """Put what `alter` makes of the table in its place."""
        alter(pd.read_csv(self.table)).to_csv(self.table, index=False)

    def line(self, number: int, text: str) -> None:
        """Replace a line of the table; the header is line 1."""
        lines = self.table.read_text().splitlines()
        lines[number - 1] = text
        self.table.write_text("\n".join(lines) + "\n")

    def complaint(self, *, resample: bool = False) -> str:
        """The message with which the recording is refused."""
        before = sorted(self.table.parent.iterdir())
        with pytest.raises(InputError) as caught:
            read(self.table, resample=resample)
        assert sorted(self.table.parent.iterdir()) == before
        return str(caught.value)


@pytest.fixture
def lift(tmp_path: Path) -> Desk:
    """The isotonic sample."""
    return Desk(tmp_path, "lift")


@pytest.fixture
def bench(tmp_path: Path) -> Desk:
    """The driven sample."""
    return Desk(tmp_path, "bench")


@pytest.fixture
def swing(tmp_path: Path) -> Desk:
    """The joint sample."""
    return Desk(tmp_path, "swing")
