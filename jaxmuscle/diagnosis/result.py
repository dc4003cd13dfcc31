"""Result of a diagnosis: as text, in a notebook, as a figure, as a report, in a file."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

from matplotlib.figure import Figure

from jaxmuscle.diagnosis.diagnosis_data import DiagnosisData
from jaxmuscle.diagnosis.diagnosis_files import load, save
from jaxmuscle.diagnosis.trace_figure import diagnosis_figure
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.formatting import aligned, estimate, parameter_words, percent, probability, quantity, words
from jaxmuscle.notebook_html import Sparkline, Table, View


@dataclasses.dataclass(frozen=True, repr=False)
class Diagnosis(DiagnosisData):
    """The outcome of :func:`jaxmuscle.diagnose`.

    Its attributes are those of :class:`~jaxmuscle.diagnosis.diagnosis_data.DiagnosisData`.
    """

    def __repr__(self) -> str:
        """What `print` and a notebook show: verdict, effects with their parameters, errors on unseen data."""
        found = [f"{self.recording.name}: {self.verdict}"]
        for effect in self.added:
            values = (f"{name} {estimate(e.value, e.std, e.unit)}" for name, e in effect.parameters.items())
            found.append(f"{effect.name}: {', '.join(values)}")
        before, after = self.before["held_out"], self.after["held_out"]
        sizes = {name: (before[name].rmse, e.rmse, self.noise[name]) for name, e in after.items()}
        rows = [(name, *(quantity(x, after[name].unit) for x in each)) for name, each in sizes.items()]
        return "\n".join([*found, aligned(("error on unseen data", "before", "after", "sensor noise"), rows)])

    def _repr_html_(self) -> str:
        """What a notebook shows: verdict, effects, errors with their course, parameters."""
        return _view(self).html()

    def plot(self, column: str | None = None) -> Figure:
        """A matplotlib figure: what was measured and predicted, the errors beside the sensor's noise, and
        the stretch of unseen data that tells most, in the units of the card.

        Args:
            column: one column; all that are predicted when not given.

        Raises:
            InputError: no such column is predicted.
        """
        known = list(self.after["held_out"])
        if column is not None and column not in known:
            raise InputError(f"column: {column!r} is not predicted{nearest(column, known)}")
        return diagnosis_figure(self, known if column is None else [column])

    def report(self, folder: str | Path) -> list[Path]:
        """Write into a folder what `jaxmuscle diagnose` does: ``report.html``, which needs no network,
        ``result.json`` (SI), and ``card.toml`` with the fitted values and what was found.

        Returns:
            the files written; all of them are, or none.

        Raises:
            InputError: the folder cannot be written, or is a file.
        """
        # Reports read diagnoses: that package imports this one, and is imported when it is asked for.
        return importlib.import_module("jaxmuscle.report.report_files").write(self, folder)

    def save(self, path: str | Path) -> Path:
        """Write everything as JSON, with every bit of the numbers; :meth:`load` reads it back.

        Raises:
            InputError: the file cannot be written, or the machine is of a rig that a file cannot name.
        """
        return save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> Diagnosis:
        """A diagnosis as it was saved.

        Raises:
            InputError: no such file, or not a saved diagnosis.
        """
        return load(path, cls)


MOODS = {"complete": "good", "effects found": ""}
"""Verdict → how a notebook marks it; every other is a doubt."""


def _view(diagnosis: Diagnosis) -> View:
    traces, errors = diagnosis.traces, (diagnosis.before["held_out"], diagnosis.after["held_out"])
    columns = [
        (
            words(name),
            *(quantity(part[name].rmse, part[name].unit) for part in errors),
            quantity(diagnosis.noise[name], errors[1][name].unit),
            Sparkline(traces.measured[name], traces.after[name]),
        )
        for name in errors[1]
    ]
    effects = [
        (
            words(effect.name),
            ", ".join(f"{words(n)} {estimate(e.value, e.std, e.unit)}" for n, e in effect.parameters.items()),
            words(effect.signal),
            f"{percent(effect.gain)} ({probability(effect.p_value)})",
        )
        for effect in diagnosis.added
    ]
    parameters = [
        (parameter_words(name), estimate(e.value, e.std, e.unit), e.meaning)
        for name, e in diagnosis.parameters.items()
    ]
    left = [
        (
            words(each.signal),
            f"{each.rms_in_noise:.2g}",
            ", ".join(map(words, each.depends_on)),
            str(each.pattern or ""),
        )
        for each in diagnosis.unexplained
    ]
    return View(
        "diagnosis",
        diagnosis.recording.name,
        (f"rig {diagnosis.recording.card.rig}", f"{diagnosis.seconds:.0f} s"),
        badge=diagnosis.verdict,
        mood=MOODS.get(diagnosis.verdict, "doubt"),
        tables=[
            Table("effects added", ("", "value", "acts on", "removes of the excess error"), effects),
            Table("error on unseen data", ("", "before", "after", "noise", "measured, model"), columns),
            Table("parameters", ("", "value", "meaning"), parameters, open=False),
            Table("left unexplained", ("", "times the noise", "depends on", "pattern"), left, open=False),
        ],
        notes=[] if diagnosis.converged else ["A fit stopped before it had converged."],
    )
