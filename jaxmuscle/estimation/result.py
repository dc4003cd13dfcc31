"""The outcome of a fit, and what can be done with it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import jaxmuscle
from jaxmuscle.estimation.again import fitted_start
from jaxmuscle.estimation.cards import fitted_card
from jaxmuscle.estimation.data import FitData
from jaxmuscle.estimation.figures import plot
from jaxmuscle.estimation.notes import notes
from jaxmuscle.estimation.saved import load, save
from jaxmuscle.estimation.summary import summary
from jaxmuscle.recordings.card import Card
from jaxmuscle.recordings.recording import Recording


@dataclasses.dataclass(frozen=True)
class FitResult(FitData):
    """The outcome of :func:`jaxmuscle.fit`; its numbers are those of :class:`FitData`."""

    def __repr__(self) -> str:
        """What `print(fit)` and a notebook show: values, residuals, notes."""
        return summary(self)

    def notes(self) -> list[str]:
        """What a reader has to know, one sentence each: how it ended, what is not determined, doubts."""
        return notes(self)

    def to_card(self, recording: str | int = 0) -> Card:
        """The card of a recording with the fitted values and their standard deviations.

        As priors these are for other recordings; fitted to the same one again, its data count twice.
        Each is a prior by itself: a card has no place for correlations. Where these are close to ±1 the card
        knows less of combinations than the fit did, and a fit of new data that begins with it is too sure of
        single values: its intervals are too short. Fit the recordings together instead, as one list.
        """
        return fitted_card(self, recording)

    def plot(self, recording: str | int = 0) -> Figure:
        """A matplotlib figure: fit, residuals, their autocorrelation, and the profiles if there are any."""
        return plot(self, recording)

    def save(self, path: str | Path) -> Path:
        """Write everything, as TOML if `path` ends in ``.toml``, else as JSON.

        :func:`FitResult.load` reads it back without loss.
        """
        return save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> FitResult:
        """A result as it was saved.

        Raises:
            InputError: no such file, or not a saved fit.
        """
        return load(path, cls)

    def refit(self, recordings: Recording | Sequence[Recording], **changes: Any) -> FitResult:
        """Fit again from the fitted values, with the same settings and masks except for `changes`.

        `starts`, `budget` and `solver` are not kept: there is one start, where this fit ended, no limit in
        time, and our own solver.
        """
        settings = {**self.settings, **changes}
        if "starts" not in changes:
            settings["starts"] = [fitted_start(self, recordings, settings)]
        return jaxmuscle.fit(self.actuator, recordings, **settings)
